"""Points of a robot that stand for our joints, how its bodies are turned against ours, and its soles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from scenectl.retarget.robots.mapping import SIDES, Tree
from scenectl.retarget.robots.shapes import corners
from scenes.errors import UserError

WORLD = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From our world (y up) to a robot's (z up): (x, y, z) is (x, -z, y); its transpose is `TO_Y_UP["z"]`."""
_LEVEL = 0.01
"""Metres above the lowest point of a foot up to which its sole is level."""
_ALIKE, _DOWN, _LARGER = np.radians(5), np.radians(60), 2.0
"""Angle up to which facets are one flat part, angle to straight down of a sole at most, and how many times as large as
what is level another part is that is the sole: feet of robots at rest point down by 45 degrees at most."""


@dataclass(frozen=True)
class Points:
    """A robot's joints as ours, at rest in our frame: metres, y up, left +x, facing +z, from the middle of its hips.

    Attributes:
        bodies: {our joint: (the body that carries it, where on it, m)}. A joint is where the axes of its hinges meet
            and hangs on the body above them, so that they don't move it: a wrist on the forearm.
        at: {our joint: where it is, ``[3]``}; `left_foot` and `right_foot` are the tips of the soles.
        turn: from the robot's world at rest to that frame, ``[3, 3]``.
        heels: {side: the heel's sole against the ankle, ``[3]``}.
        flats: {side: from the foot at rest to the foot with a level sole, in the robot's world, ``[3, 3]``}.
        doubts: one sentence where feet have no shapes.
    """

    bodies: dict[str, tuple[int, np.ndarray]]
    at: dict[str, np.ndarray]
    turn: Float[np.ndarray, "3 3"]
    heels: dict[str, np.ndarray]
    flats: dict[str, np.ndarray]
    doubts: tuple[str, ...] = ()

    def length(self, a: str, b: str) -> float:
        """Metres between two joints at rest."""
        return float(np.linalg.norm(self.at[a] - self.at[b]))

    @property
    def legs(self) -> float:
        """Height (m) of the hips over the soles with both legs stretched."""
        lengths = [
            self.length(f"{side}_hip", f"{side}_knee") + self.length(f"{side}_knee", f"{side}_ankle")
            - self.at[f"{side}_foot"][1] + self.at[f"{side}_ankle"][1]
            for side in SIDES
        ]  # fmt: skip
        return sum(lengths) / 2


def points_of(tree: Tree, joints: Mapping[str, str], source: str) -> Points:
    """The points of a robot whose joints are mapped; raises UserError where its limbs have no length."""
    body = {joint: tree.names.index(name) for joint, name in joints.items()}
    world, bodies = dict[str, np.ndarray](), dict[str, tuple[int, np.ndarray]]()

    def put(joint: str, on: int, place: np.ndarray) -> None:
        world[joint] = place
        bodies[joint] = on, tree.rest.xmat[on].reshape(3, 3).T @ (place - tree.rest.xpos[on])

    for joint in body:
        side, _, part = joint.partition("_")
        if part not in _ABOVE:
            continue
        on = body[above if (above := _ABOVE[part]) in body else f"{side}_{above}"]
        moving = tree.between(on, body[joint])
        put(joint, on, meeting(tree.anchors[moving], tree.axes[moving]) if moving else tree.rest.xpos[body[joint]])
        if part == "wrist" and body[joint] == on:
            put(joint, on, tree.tip(on, world[f"{side}_elbow"]))
    turn, flats, heels = _facing(world), dict[str, np.ndarray](), dict[str, np.ndarray]()
    for side in SIDES:
        foot, ankle = body[f"{side}_ankle"], world[f"{side}_ankle"]
        points = corners(tree.model, tree.rest, [one for one in range(tree.model.nbody) if foot in tree.chain(one)])
        flats[side] = flat = _flat(points)
        tip, heel = _sole((points - ankle) @ flat.T, turn)
        put(f"{side}_foot", foot, ankle + flat.T @ tip)
        world[f"{side}_foot"], heels[side] = ankle + tip, turn @ heel
    put("pelvis", body["pelvis"], (world["left_hip"] + world["right_hip"]) / 2)
    put("spine3", body["spine3"], (world["left_shoulder"] + world["right_shoulder"]) / 2)
    if "head" in body:
        place = corners(tree.model, tree.rest, [body["head"]])
        put("head", body["head"], place.mean(axis=0) if len(place) else tree.rest.xipos[body["head"]])
    at = {joint: turn @ (place - world["pelvis"]) for joint, place in world.items()}
    bare = all(np.allclose(at[f"{side}_foot"], at[f"{side}_ankle"]) for side in SIDES)
    doubts = ("its feet have no shapes; it stands on its ankles, so give the file with shapes",) if bare else ()
    found = Points(bodies, at, turn, heels, flats, doubts)
    for a, b in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist")):
        if min(found.length(f"{side}_{a}", f"{side}_{b}") for side in SIDES) < 0.01:
            raise UserError(f"'{source}' has no length between {a} and {b}; state other bodies in `joints`")
    return found


_ABOVE = {"hip": "pelvis", "knee": "hip", "ankle": "knee", "shoulder": "spine3", "elbow": "shoulder", "wrist": "elbow"}


def meeting(anchors: Float[np.ndarray, "n 3"], axes: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "3"]:
    """The point nearest to some axes; along a single direction, near the last anchor."""
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    pull = 1e-3  # decides only along what the axes leave open
    place: np.ndarray = np.linalg.solve(
        across.sum(axis=0) + pull * np.eye(3), (across @ anchors[:, :, None]).sum(axis=0)[:, 0] + pull * anchors[-1]
    )
    return place


def _facing(world: dict[str, np.ndarray]) -> Float[np.ndarray, "3 3"]:
    """Rows: the robot's left, up and ahead in its world at rest."""
    left = (world["left_hip"] - world["right_hip"]) * [1, 1, 0]
    left /= max(float(np.linalg.norm(left)), 1e-9)
    return np.stack([left, np.array([0.0, 0.0, 1.0]), np.cross(left, [0.0, 0.0, 1.0])])


def _sole(points: Float[np.ndarray, "n 3"], turn: Float[np.ndarray, "3 3"]) -> tuple[np.ndarray, np.ndarray]:
    """The foremost and the hindmost point of a level sole against its ankle, both ahead of it or behind.

    Args:
        points: of the foot, against its ankle (m, world).
        turn: the robot's left, up and ahead.
    """
    if not len(points):  # a foot without a shape is a point
        return np.zeros(3), np.zeros(3)
    sole = points[:, 2].min()
    ahead = points[points[:, 2] < sole + _LEVEL] @ turn[2]
    up = np.array([0.0, 0.0, sole])
    return turn[2] * ahead.max() + up, turn[2] * ahead.min() + up


def _flat(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "3 3"]:
    """The least rotation that makes a foot's sole level: the largest flat part of its hull that looks down.

    None is needed where the part that is level is nearly as large: flat feet, and round ones.
    """
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):  # no points, or all in one plane
        return np.eye(3)
    normals, (a, b, c) = hull.equations[:, :3], points[hull.simplices].swapaxes(0, 1)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    flat = (normals @ normals.T > np.cos(_ALIKE)) @ areas
    flat[normals[:, 2] > -np.cos(_DOWN)] = 0
    level = areas[normals[:, 2] < -np.cos(2 * _ALIKE)].sum()
    if flat.max() < _LARGER * level:
        return np.eye(3)
    turn: np.ndarray = Rotation.align_vectors([[0.0, 0.0, -1.0]], [normals[flat.argmax()]])[0].as_matrix()
    return turn
