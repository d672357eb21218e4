"""What is seen of a scene, for files of other tools: triangles with colours, and the ways of what moves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8

from scenes.mesh.colours import OBSTACLE, face_colours
from scenes.mesh.content import distinct
from scenes.mesh.mesh import Mesh, hull
from scenes.mesh.primitives import Capsule, Plane, Sphere
from scenes.motion.frames import HOME
from scenes.motion.rotations import steady, unit_quaternions
from scenes.motion.waypoints import moment
from scenes.world.moving import MovingObject
from scenes.world.scene import Scene

MARGIN = 1.5
"""Metres by which a floor that has no end reaches beyond what stands and walks on it, as in pictures."""
_BELOW = 1e-3
"""Metres by which walls without an end reach below the floor."""


@dataclass(frozen=True, eq=False)
class Thing:
    """One thing of a scene.

    Attributes:
        name: no other thing's.
        vertices: ``[V, 3]`` metres; in the world (y up), or in the frame of what moves.
        faces: ``[F, 3]``, counter-clockwise as seen from the front.
        colours: of each face, sRGB, ``[F, 3]``.
        places: of the frame of what moves, world metres, ``[T, 3]``; None of what stands still.
        turns: unit quaternions (w, x, y, z) of that frame without changes of sign, ``[T, 4]``; None of what stands
            still.
    """

    name: str
    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    colours: UInt8[np.ndarray, "F 3"]
    places: Float[np.ndarray, "T 3"] | None = None
    turns: Float[np.ndarray, "T 4"] | None = None


def things(scene: Scene, times: np.ndarray, around: np.ndarray | None = None) -> list[Thing]:
    """Everything that is seen of a scene.

    Args:
        scene: with its frame of its own or not; what comes back is stated in the world.
        times: on the scene's clock, seconds, ``[T]``, at which to say where things are.
        around: points ``[..., 3]`` (m, world) that planes without an end, such as the floor, reach beyond too.
    """
    scene, seconds = scene.seen_from(HOME), torch.as_tensor(np.asarray(times, dtype=np.float64))
    found = [Thing(mesh.name, mesh.vertices, mesh.faces, face_colours(mesh)) for mesh in scene.meshes]
    found += [_moving(thing, seconds) for thing in scene.moving]
    box = _box(scene, around)
    floors = () if scene.meshes else scene.planes  # a floor of meshes is seen, and a plane would lie in the same place
    shapes = [(type(shape).__name__.lower(), shape) for shape in scene.primitives if shape not in scene.moving]
    for name, shape in (*shapes, *(("floor", plane) for plane in floors)):
        if (mesh := _within(shape, box) if isinstance(shape, Plane) else shape.mesh()) is not None:
            found.append(Thing(name, mesh.vertices, mesh.faces, face_colours(mesh)))
    names = distinct(thing.name for thing in found)
    return [replace(thing, name=name) for thing, name in zip(found, names, strict=True)]


def flat(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]
) -> tuple[Float[np.ndarray, "S 3"], Bool[np.ndarray, " F"]]:
    """Unit normals of the faces that have one in single precision, and which these are: of others nothing is seen."""
    corners = vertices[faces].astype(np.float32)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).astype(np.float64)
    sizes = np.linalg.norm(normals, axis=1)
    return normals[sizes > 0] / sizes[sizes > 0, None], sizes > 0


def _moving(thing: MovingObject | Sphere | Capsule, seconds: torch.Tensor) -> Thing:
    """What moves, in its own frame, with where that is."""
    if isinstance(thing, MovingObject):
        solid, (places, turned) = thing.solid, thing.trajectory.at(seconds)
        quaternions = steady(unit_quaternions(turned)[:, None])[:, 0].numpy()
        colours = face_colours(solid, OBSTACLE)
        return Thing(thing.name, solid.vertices, solid.faces, colours, places.numpy(), quaternions)
    assert thing.motion is not None
    way, start = thing.motion.at(seconds).numpy(), thing.motion.at(moment(0.0)).numpy()
    mesh, unturned = thing.mesh(), np.tile([1.0, 0.0, 0.0, 0.0], (len(seconds), 1))
    name = type(thing).__name__.lower()
    return Thing(name, mesh.vertices - start, mesh.faces, face_colours(mesh, OBSTACLE), way, unturned)


def _box(scene: Scene, around: np.ndarray | None) -> np.ndarray:
    """Bounds ``[2, 3]`` (m) within which planes without an end are shown."""
    boxes = [] if scene.extent is None else [scene.extent]
    if around is not None:
        points = np.asarray(around, dtype=np.float64).reshape(-1, 3)
        boxes.append(np.stack([points.min(axis=0), points.max(axis=0)]))
    low, high = hull(boxes or [scene.bounds])
    if scene.stated_floor is not None:
        low[1] = min(low[1], scene.stated_floor)
    return np.stack([low - [MARGIN, _BELOW, MARGIN], high + MARGIN])


def _within(plane: Plane, box: np.ndarray) -> Mesh | None:
    """What of a plane lies in a box ``[2, 3]`` (m); None where nothing does."""
    from trimesh.intersections import slice_faces_plane

    middle, normal = box.mean(axis=0), np.array(plane.normal)
    near = middle - (middle - plane.point) @ normal * normal
    square = replace(plane, point=tuple(near)).mesh(2 * float(np.linalg.norm(np.ptp(box, axis=0))))
    vertices, faces = np.array(square.vertices), np.array(square.faces)
    for corner, sign in ((0, 1.0), (1, -1.0)):
        for axis in range(3):
            if not len(faces):
                return None
            vertices, faces, _ = slice_faces_plane(vertices, faces, sign * np.eye(3)[axis], box[corner])
    return Mesh(vertices, faces, "plane", "primitive") if len(faces) else None
