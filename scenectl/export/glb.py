"""GLB files out: a skinned mannequin that plays motions, and the room around it with what moves there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np

from scenectl.export.animation import Animation
from scenectl.export.gltf import Document, Tracks
from scenectl.export.mannequin import COLOUR, Mannequin
from scenectl.export.rooms import Thing, flat, things
from scenectl.export.settings import Settings
from scenes.mesh.content import distinct
from scenes.motion.bones import rest_pose
from scenes.motion.skeleton import Skeleton

SEVERAL = True
TAKES = frozenset({"scene", "t0", "character", "joints"})
COLOURS = 64
"""Materials that one thing has at most; finer shades of scans and pictures become the nearest of so many."""
_ALIKE = 1e-5
"""Metres by which bones of one mannequin may differ between motions."""


def write(animations: Sequence[Animation], path: Path, settings: Settings) -> None:
    """Write all motions, one glTF animation each, in metres, y up, facing +z at rest.

    People of one skeleton are one mannequin. Each animation moves what moves in the scene, too, and states its frames a
    second as the extra ``fps``.

    Raises:
        UserError: a path that cannot be written, or a character that cannot be read or moved.
    """
    if settings.character is not None:
        import_module("scenectl.export.characters").write(animations, path, settings)
        return
    document = Document()
    people: list[_Person] = []
    for animation in animations:
        if not any(person.plays(animation) for person in people):
            people.append(_Person.added(document, animation, len(people)))
    moved = add_room(document, animations, settings)
    names, clocks = distinct(animation.name for animation in animations), dict[bytes, int]()
    for name, animation, moving in zip(names, animations, moved, strict=True):
        person = next(person for person in people if person.plays(animation))
        times = animation.times
        if times.tobytes() not in clocks:
            clocks[times.tobytes()] = document.times(times)
        tracks = {**person.tracks(animation), **moving}
        document.animation(name, clocks[times.tobytes()], tracks, {"fps": animation.fps})
    document.save(path)


@dataclass(frozen=True)
class _Person:
    """A mannequin in a document: its skeleton, and the nodes of the joints."""

    skeleton: Skeleton
    nodes: tuple[int, ...]

    @classmethod
    def added(cls, document: Document, animation: Animation, number: int) -> _Person:
        """Put one into a document, standing with its soles on the ground in the T-pose.

        Its joints hang on a node of their own: on the scene, Blender would make one armature of all that is in it.
        """
        skeleton, mannequin = animation.skeleton, Mannequin.of(animation)
        rest = rest_pose(skeleton).numpy()
        vertices = mannequin.vertices + rest[animation.ours[0]]
        up = np.array([0.0, -vertices[:, 1].min(), 0.0])
        count = f" {number + 1}" if number else ""
        nodes, person = list[int](), document.node(f"person{count}")
        for joint, parent in enumerate(skeleton.parents):
            place = skeleton.offsets[joint] if parent >= 0 else up
            above = nodes[parent] if parent >= 0 else person
            nodes.append(document.node(skeleton.names[joint], above, translation=[float(x) for x in place]))
        bind = np.tile(np.eye(4), (len(rest), 1, 1))
        bind[:, :3, 3] = rest + up
        name = f"mannequin{count}"
        held = animation.ours[mannequin.joints]
        mesh = document.mesh(
            name,
            [(mannequin.faces, document.material(name, COLOUR))],
            POSITION=vertices + up,
            NORMAL=mannequin.normals,
            JOINTS_0=np.where(mannequin.weights > 0, held, 0).astype(np.uint8 if len(nodes) < 2**8 else np.uint16),
            WEIGHTS_0=mannequin.weights,
        )
        document.node(name, mesh=mesh, skin=document.skin(name, nodes, bind, nodes[0]))
        return cls(skeleton, tuple(nodes))

    def plays(self, animation: Animation) -> bool:
        """The animation is on these bones."""
        mine, other = self.skeleton, animation.skeleton
        same = (mine.names, mine.parents) == (other.names, other.parents)
        return same and bool(np.allclose(mine.offsets, other.offsets, rtol=0.0, atol=_ALIKE))

    def tracks(self, animation: Animation) -> Tracks:
        """What moves the joints."""
        turns = {(node, "rotation"): animation.rotations[:, joint] for joint, node in enumerate(self.nodes)}
        hips = {} if animation.hips is None else {(self.nodes[1], "translation"): animation.hips}
        return {(self.nodes[0], "translation"): animation.roots, **hips, **turns}


def add_room(document: Document, animations: Sequence[Animation], settings: Settings) -> list[Tracks]:
    """Put the scene of the settings, if there is one, into a document; returns what moves in it in each animation."""
    if settings.scene is None:
        return [{} for _ in animations]
    times = np.unique(np.concatenate([animation.times for animation in animations]))
    around = np.concatenate([animation.joints.reshape(-1, 3) for animation in animations])
    room = document.node(settings.scene.name)
    materials: dict[tuple[int, ...], int] = {}
    moving: list[tuple[int, Thing]] = []
    for thing in things(settings.scene, settings.t0 + times, around):
        node = document.node(thing.name, room, mesh=_mesh(document, thing, materials))
        if thing.places is not None:
            moving.append((node, thing))
    moved: list[Tracks] = []
    for animation in animations:
        at, tracks = np.searchsorted(times, animation.times), dict[tuple[int, str], np.ndarray]()
        for node, thing in moving:
            assert thing.places is not None and thing.turns is not None
            tracks |= {(node, "translation"): thing.places[at], (node, "rotation"): thing.turns[at]}
        moved.append(tracks)
    for node, thing in moving:
        assert thing.places is not None and thing.turns is not None
        document.gltf.nodes[node].translation = thing.places[0].tolist()
        document.gltf.nodes[node].rotation = np.roll(thing.turns[0], -1).tolist()
    return moved


def _mesh(document: Document, thing: Thing, materials: dict[tuple[int, ...], int]) -> int:
    """The mesh of a thing: flat triangles, those of a colour together."""
    normals, seen = flat(thing.vertices, thing.faces)
    corners = thing.vertices[thing.faces[seen]]
    rows = np.concatenate([corners, np.repeat(normals[:, None], 3, axis=1)], axis=2).astype(np.float32)
    vertices, faces = np.unique(rows.reshape(-1, 6), axis=0, return_inverse=True)
    faces = faces.reshape(-1, 3)
    colours, which = _palette(thing.colours[seen])
    parts = []
    for number, colour in enumerate(map(tuple, colours.tolist())):
        if colour not in materials:
            materials[colour] = document.material("#" + bytes(colour).hex(), colour)
        parts.append((faces[which == number], materials[colour]))
    return document.mesh(thing.name, parts, POSITION=vertices[:, :3], NORMAL=vertices[:, 3:])


def _palette(colours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """At most `COLOURS` colours ``[C, 3]``, all of them used, and which of them each of ``[F, 3]`` is."""
    if len(np.unique(colours, axis=0)) > COLOURS:
        from PIL import Image

        colours = np.asarray(Image.fromarray(colours[None]).quantize(COLOURS).convert("RGB"))[0]
    found, which = np.unique(colours, axis=0, return_inverse=True)
    return found, which.reshape(-1)
