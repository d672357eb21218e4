"""Which bodies of a robot move as which of our joints: by names, and by the tree and where it is where they don't tell.

The body of a joint is the last that the joint's axes turn: a hip of three axes is the thigh, a wrist the hand.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from scenectl.retarget.robots.shapes import corners
from scenes.errors import UserError, did_you_mean

SIDES = ("left", "right")
LEG, ARM = ("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist")
LIMBS = tuple(f"{side}_{part}" for side in SIDES for part in (*LEG, *ARM))
NAMES = ("pelvis", "spine3", "head", *LIMBS)
"""Our joints that bodies of a robot can move as; all but the head must be there. `spine3` is the chest."""

_WORDS = {
    "hip": ("hip", "thigh", "upleg", "upperleg", "femur"),
    "knee": ("knee", "shin", "calf", "shank", "lowleg", "lowerleg", "tibia"),
    "ankle": ("ankle", "foot", "talus", "calcn"),
    "shoulder": ("shoulder", "upperarm", "uparm", "humerus"),
    "elbow": ("elbow", "forearm", "lowerarm", "lowarm", "ulna", "radius"),
    "wrist": ("wrist", "hand", "palm"),
}
_FINGERS = re.compile("finger|thumb|index|middle|ring|pinky|little|gripper")
_SIDES = {"left": "left", "right": "right", "l": "left", "r": "right"}
_LIMB = "|".join(["leg", "arm", *(word for words in _WORDS.values() for word in words)])
_GLUED = re.compile(f"([lr])(?:{_LIMB})s?|(?:{_LIMB})([lr])")
"""Words with a side before or after them, such as lfemur and legl."""
_HIGHER = 0.2
"""Share of its legs by which a humanoid's shoulders are over its hips at least; those of a quadruped are level."""
_SAME = 0.9
"""Share of a distance from which another is as large: an elbow's joints are at one place, and one of them twists."""
_HANGS = 0.5
"""Share of a leg's length by which its foot is under its hip at least: legs in a deep crouch, and no fingers that point
ahead."""


def mapped(tree: Tree, source: str, stated: Mapping[str, str]) -> tuple[dict[str, str], list[str]]:
    """{our joint: body} of a humanoid, and doubts.

    Raises:
        UserError: what is stated is no joint of ours or no body; not a humanoid.
    """
    doubts = list[str]()
    for joint, body in stated.items():
        if joint not in NAMES:
            raise UserError(f"no robot is moved by our joint '{joint}'{did_you_mean(joint, NAMES)}")
        if body not in tree.names:
            raise UserError(f"body '{body}', stated as {joint}, is not in '{source}'{did_you_mean(body, tree.names)}")
    found = {**_by_names(tree), **{joint: tree.names.index(body) for joint, body in stated.items()}}
    if not _whole(tree, found):
        built = _by_geometry(tree, source)
        doubts.append("names of bodies and joints don't tell which are ours; they were told by geometry")
        found = {**built, **{joint: tree.names.index(body) for joint, body in stated.items()}}
        if not _whole(tree, found):
            raise UserError(f"the bodies stated for '{source}' don't hang on each other as limbs do; check them")
    for side in SIDES:
        found.setdefault(f"{side}_wrist", found[f"{side}_elbow"])
    found.setdefault("pelvis", tree.above(found["left_hip"], found["right_hip"]))
    found.setdefault("spine3", tree.above(found["left_shoulder"], found["right_shoulder"]))
    if "head" not in found and (head := _head(tree, found)) is not None:
        found["head"] = head
    return {joint: tree.names[found[joint]] for joint in NAMES if joint in found}, doubts


class Tree:
    """Bodies of a robot at rest.

    Attributes:
        names: of bodies, the world first.
        parents: of bodies.
        joints: indices of each body's joints, the free one left out.
        anchors, axes: of all joints (m, world, at rest), ``[njnt, 3]``.
        model, rest: MuJoCo's.
    """

    def __init__(self, model: Any, rest: Any) -> None:
        self.model, self.rest = model, rest
        self.names = [model.body(i).name for i in range(model.nbody)]
        self.parents = model.body_parentid
        first, count = model.body_jntadr, model.body_jntnum
        self.joints = [[j for j in range(first[b], first[b] + count[b]) if j > 0] for b in range(model.nbody)]
        self.anchors, self.axes = self.rest.xanchor, self.rest.xaxis

    def chain(self, body: int) -> list[int]:
        """Bodies from the robot's root down to one."""
        way = [body]
        while self.parents[way[0]] > 0:
            way.insert(0, int(self.parents[way[0]]))
        return way

    def above(self, a: int, b: int) -> int:
        """The last body that carries both, and is neither."""
        ways = self.chain(a)[:-1], self.chain(b)[:-1]
        return [one for one, other in zip(*ways, strict=False) if one == other][-1]

    def between(self, top: int, body: int) -> list[int]:
        """Joints below `top` down to `body`."""
        way = self.chain(body)
        way = way[way.index(top) + 1 :] if top in way else way
        return [joint for one in way for joint in self.joints[one]]

    def limbs(self, mapped: Iterable[str]) -> Int[np.ndarray, " nbody"]:
        """Of each body, the mapped one of its limb: the first below it, or above where none is."""
        ours = {self.names.index(name) for name in mapped}
        found, below = np.zeros(len(self.names), int), dict[int, int]()
        for body in sorted(ours, key=lambda one: len(self.chain(one))):
            for one in self.chain(body):
                below.setdefault(one, body)
        for body in range(1, len(self.names)):
            found[body] = below.get(body, found[self.parents[body]])
        return found

    def tip(self, body: int, start: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """The far end of a body's shapes, or of the bodies on it where it has none, as seen from `start` (m, world)."""
        points = corners(self.model, self.rest, [body])
        if not len(points):
            on = [other for other in range(len(self.names)) if other != body and body in self.chain(other)]
            points = self.rest.xpos[on] if on else self.rest.xipos[[body]]
        way = points.mean(axis=0) - start
        way /= max(float(np.linalg.norm(way)), 1e-9)
        end: np.ndarray = start + float(((points - start) @ way).max()) * way
        return end


def _whole(tree: Tree, found: Mapping[str, int]) -> bool:
    """Whether all limbs are there, each body below the one before and moved against it."""
    for side in SIDES:
        for limb in (LEG, ARM):
            bodies = [found.get(f"{side}_{part}") for part in limb]
            bodies = bodies[:-1] if limb == ARM and bodies[-1] is None else bodies
            if None in bodies or not tree.between(0, bodies[0]):  # type: ignore[arg-type]
                return False
            for top, body in zip(bodies[:-1], bodies[1:], strict=True):
                if body != top and top not in tree.chain(body):  # type: ignore[arg-type]
                    return False
            if bodies[0] == bodies[1] or (limb == LEG and bodies[1] == bodies[2]):
                return False
    limbs = [found[name] for name in ("left_hip", "right_hip", "left_shoulder", "right_shoulder")]
    return len(set(limbs)) == 4


def _by_names(tree: Tree) -> dict[str, int]:
    found, fixed = dict[str, int](), dict[str, int]()
    for body, name in enumerate(tree.names):
        told = [tree.model.joint(joint).name for joint in tree.joints[body]]
        parts = [part for text in (*told, name) if (part := _part(text))]
        if not parts or any(_FINGERS.search("".join(_words(text))) for text in (*told, name)):
            continue
        if told:
            found[parts[0]] = body  # the last of several on a chain
        else:
            fixed.setdefault(parts[0], body)
    return {**fixed, **found}


def _words(name: str) -> list[str]:
    return [word.lower() for word in re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+", name)]


def _side(name: str) -> str | None:
    """The side that a name tells."""
    words = _words(name)
    if side := next((_SIDES[word] for word in words if word in _SIDES), None):
        return side
    if glued := next((found for word in words if (found := _GLUED.fullmatch(word))), None):
        return _SIDES[glued[1] or glued[2]]
    return next((side for side in SIDES if "".join(words).startswith(side)), None)


def _part(name: str) -> str | None:
    """Our joint that a name tells."""
    side, text = _side(name), "".join(word for word in _words(name) if word not in _SIDES)
    if side is None or _FINGERS.search(text):
        return None
    return next((f"{side}_{part}" for part, known in _WORDS.items() if any(word in text for word in known)), None)


def _by_geometry(tree: Tree, source: str) -> dict[str, int]:
    leaves = [b for b in range(1, len(tree.names)) if b not in tree.parents]
    pairs = [
        (a, b, above) for a, b in combinations(leaves, 2)
        if min(len(tree.between(above := tree.above(a, b), end)) for end in (a, b)) >= 3
    ]  # fmt: skip
    none = UserError(f"'{source}' is no humanoid: two legs that hang down and two arms above them were not found")
    if not pairs:
        raise none

    def tips(ends: Sequence[int]) -> np.ndarray:
        return np.stack([tree.tip(end, tree.anchors[tree.between(0, end)[-1]]) for end in ends])

    def first(above: int, end: int) -> np.ndarray:
        return tree.anchors[tree.between(above, end)[0]]

    def drop(pair: tuple[int, int, int]) -> float:
        return float(min(first(pair[2], end)[2] - tips([end])[0, 2] for end in pair[:2]))

    def length(pair: tuple[int, int, int]) -> float:
        return min(
            float(np.linalg.norm(np.diff(tree.anchors[tree.between(pair[2], e)], axis=0), axis=1).sum())
            for e in pair[:2]
        )

    legs = max(pairs, key=drop)
    if drop(legs) < _HANGS * length(legs):
        raise none
    taken = {body for end in legs[:2] for body in tree.chain(end)[len(tree.chain(legs[2])) :]}
    free = [pair for pair in pairs if not taken & {*tree.chain(pair[0]), *tree.chain(pair[1])}]
    if not free:
        raise none
    arms = max(free, key=length)
    hips, shoulders = (np.stack([first(pair[2], end) for end in pair[:2]]) for pair in (legs, arms))
    if shoulders[:, 2].mean() - hips[:, 2].mean() < _HIGHER * drop(legs):
        raise none
    left = _left(tree, legs[:2], hips)
    found = {"pelvis": legs[2], "spine3": arms[2]}
    for limb, pair, at in ((LEG, legs, hips), (ARM, arms, shoulders)):
        for side, i in zip(SIDES, _order(tree, pair, at @ left), strict=True):
            found |= {
                f"{side}_{part}": body for part, body in zip(limb, _parts(tree, pair[2], pair[i], limb), strict=True)
            }
    return found


def _order(tree: Tree, pair: tuple[int, int, int], across: Float[np.ndarray, "2"]) -> list[int]:
    """Which of two limbs is the left one, then the other: as names tell, or by how far (m) they are to the left."""
    told = [_told(tree, pair[2], end) for end in pair[:2]]
    if None not in told and told[0] != told[1]:
        return [told.index(side) for side in SIDES]
    return [int(i) for i in np.argsort(-across)]


def _told(tree: Tree, above: int, end: int) -> str | None:
    """The side of a limb that the names of its bodies and joints tell."""
    bodies = tree.chain(end)[len(tree.chain(above)) :]
    names = [name for b in bodies for name in (tree.names[b], *(tree.model.joint(j).name for j in tree.joints[b]))]
    return next((side for name in names if (side := _side(name))), None)


def _hand(tree: Tree, above: int, end: int) -> int:
    """The last body of an arm before its fingers: the first one, three joints down, that several chains move on."""

    def moves(body: int) -> bool:
        return any(joints and body in tree.chain(other) for other, joints in enumerate(tree.joints))

    for body in tree.chain(end)[len(tree.chain(above)) :]:
        if len(tree.between(above, body)) >= len(ARM):
            on = [child for child, parent in enumerate(tree.parents) if parent == body and moves(child)]
            if len(on) > 1 or any(_FINGERS.search(tree.names[child].lower()) for child in on):
                return body
    return end


def _parts(tree: Tree, above: int, end: int, limb: Sequence[str]) -> list[int]:
    """Bodies of a limb: its middle joint is the one that is farthest from both of its ends, and bends it there."""
    end = end if limb == LEG else _hand(tree, above, end)
    joints = tree.between(above, end)
    places = tree.anchors[joints]
    last = places[-1] if limb == LEG else tree.tip(end, places[-1])
    near = np.minimum(*(np.linalg.norm(places - place, axis=1) for place in (places[0], last)))
    way = (last - places[0]) / max(float(np.linalg.norm(last - places[0])), 1e-9)
    bends = np.linalg.norm(np.cross(tree.axes[joints], way), axis=1)
    middle = max(int(np.where(near >= _SAME * near.max(), bends, -1.0).argmax()), 1)
    bodies = tree.model.jnt_bodyid[joints]
    return [int(bodies[middle - 1]), int(bodies[middle]), int(bodies[-1])]


def _left(tree: Tree, feet: Sequence[int], hips: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "3"]:
    """To the robot's left at rest: along its hips, so that its feet point ahead, or else that it faces x."""
    across = (hips[0] - hips[1]) * [1, 1, 0]
    across /= max(float(np.linalg.norm(across)), 1e-9)
    ahead = np.cross(across, [0, 0, 1])
    point = 0.0
    for foot in feet:
        ankle = tree.between(0, foot)[-1]
        whole = [b for b in range(len(tree.names)) if tree.model.jnt_bodyid[ankle] in tree.chain(b)]
        if len(points := corners(tree.model, tree.rest, whole)):
            point += float((points.mean(axis=0) - tree.anchors[ankle]) @ ahead)
    told = point if abs(point) > 0.01 else ahead[0]
    left: np.ndarray = across if told >= 0 else -across
    return left


def _head(tree: Tree, found: Mapping[str, int]) -> int | None:
    """The body of the head: by its name, or one over the shoulders that the chest carries, moved or not."""
    named = [body for body, name in enumerate(tree.names) if "head" in name.lower()]
    if named:
        return named[0]
    arms = {body for side in SIDES for body in tree.chain(found[f"{side}_wrist"])}
    height = max(tree.rest.xpos[found[f"{side}_shoulder"]][2] for side in SIDES)
    over = [
        body for body in range(1, len(tree.names))
        if found["spine3"] in tree.chain(body)[:-1] and body not in arms and tree.joints[body]
        and not set(tree.chain(body)) & {found["left_shoulder"], found["right_shoulder"]}
        and tree.rest.xpos[body][2] > height
    ]  # fmt: skip
    return max(over, default=None)
