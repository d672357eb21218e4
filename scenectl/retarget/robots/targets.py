"""Where a robot's joints and bodies should be: a motion scaled to the robot, limb by limb, its feet planted.

Limbs keep the directions of the motion's and get the robot's lengths, so that a robot of the motion's own proportions
follows it as it is. The way of the hips is scaled by the legs, about the ground under the first frame. Ankles go the
same way, as far apart as the robot's hips want them, over soles that are as high over the ground as the motion's,
in proportion; a sole that stands is level where the motion's nearly is, and stays where it stands. Knees bend in the
motion's planes between hips and ankles.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.interpolate import CubicSpline
from scipy.ndimage import distance_transform_edt
from scipy.spatial.transform import Rotation

from scenectl.retarget.plants import Plant, plants
from scenectl.retarget.robots.mapping import SIDES
from scenectl.retarget.robots.points import WORLD, Points
from scenes.body.body import DEFAULT_BODY
from scenes.errors import UserError
from scenes.motion.kinematics import orientations
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid
from scenes.motion.skeleton import HUMANML3D, Skeleton, size_of

TURNED = ("pelvis", "spine3", "head", "left_ankle", "right_ankle")
"""Joints of ours whose rotation a robot's bodies follow."""
_ASKED = (*TURNED, "left_hip", "right_hip")
_LEVEL = np.radians(20)
"""Tilt up to which a sole that stands is meant to be level: what joints of a flat foot are off in recordings, and half
of what a heel that has risen has."""
_RAMP = 0.12
"""Seconds in which a foot becomes level before it stands, and after: from the heel's strike to the whole sole's, a
tenth of a stride of 1.1 s (Perry, Gait Analysis, 1992)."""


@dataclass(frozen=True)
class Targets:
    """What a robot follows, frame by frame, in its own world (metres, z up).

    Attributes:
        places: {our joint: ``[T, 3]``}.
        turns: {our joint: how the body that moves as it does is turned, ``[T, 3, 3]``}.
        source: the same as a motion of our 22 joints, metres, y up.
        plants: where the robot's feet are to stand, in the frame of `source`.
    """

    places: dict[str, Float[np.ndarray, "T 3"]]
    turns: dict[str, Float[np.ndarray, "T 3 3"]]
    source: Motion
    plants: tuple[Plant, ...]


def resampled(motion: Motion, fps: float) -> Motion:
    """One motion's valid frames at another rate: cubic splines through all joints, bones as long as before.

    Raises:
        UserError: a batch, no valid frame or one that is not finite, or another skeleton than our 22 joints.
    """
    if motion.joints.ndim != 3:
        raise UserError(f"a robot follows one motion, not {tuple(motion.joints.shape[:-3])}; choose one of them")
    if (motion.skeleton.names, motion.skeleton.parents) != (HUMANML3D.names, HUMANML3D.parents):
        raise UserError("robots follow motions of HumanML3D's 22 joints; this one has others")
    joints = motion.joints.detach()[motion.valid].double().cpu()
    if len(joints) == 0:
        raise UserError("a motion without a valid frame moves no robot; give another")
    if not joints.isfinite().all():
        raise UserError("a motion with NaN or infinite joints in valid frames moves no robot; mark these as not valid")
    times = np.arange(len(joints)) / motion.fps
    if len(times) > 1:
        at = np.minimum(np.arange(int(times[-1] * fps + 1e-6) + 1) / fps, times[-1])
        joints = torch.from_numpy(CubicSpline(times, joints.numpy())(at))
    return rigid(replace(motion, joints=joints, valid=torch.ones(len(joints), dtype=torch.bool), fps=fps))


def targets(motion: Motion, points: Points) -> Targets:
    """A motion of the rate of the trajectory, scaled to a robot."""
    body, skeleton = Body(points, motion.skeleton), motion.skeleton
    joints = motion.joints.double().numpy()
    turns = dict(zip(_ASKED, np.moveaxis(orientations(motion, _ASKED).numpy(), 1, 0), strict=True))
    standing = tuple(plants(motion))
    origin = _ground(joints, skeleton, standing)
    places = body.scaled(joints - origin, turns)
    held = list[Plant]()
    for side in SIDES:
        held += _stand(side, places, turns, standing, motion, body)
        _knee(side, places, turns, points)
    rest = np.zeros((1, len(skeleton.names), 3))
    for parent, joint in skeleton.bones:
        rest[:, joint] = rest[:, parent] + skeleton.offsets[joint]
    t_pose = body.scaled(rest - _ground(rest, skeleton, ()), {name: np.eye(3)[None] for name in _ASKED})
    joined = np.stack([places[name] for name in skeleton.names], axis=1) + origin
    source = replace(motion, joints=torch.from_numpy(joined), skeleton=_skeleton(t_pose, skeleton))
    world = {name: (place + origin) @ WORLD.T for name, place in places.items() if name in points.bodies}
    world["pelvis"] = (places["hips"] + origin) @ WORLD.T
    carried = {name: WORLD @ turns[name] for name in TURNED}
    return Targets(world, carried, source, tuple(replace(plant, place=plant.place + origin) for plant in held))


class Body:
    """A robot's points against a skeleton of ours.

    Attributes:
        points: the robot's.
        legs: how many times as long as the skeleton's its legs are.
        trunk: how many times as long the way from its hips to its shoulders is.
    """

    def __init__(self, points: Points, skeleton: Skeleton) -> None:
        self.points, self.skeleton = points, skeleton
        rest = np.zeros((len(skeleton.names), 3))
        for parent, joint in skeleton.bones:
            rest[joint] = rest[parent] + skeleton.offsets[joint]
        at = {name: rest[i] for i, name in enumerate(skeleton.names)}
        self.hips = (at["left_hip"] + at["right_hip"]) / 2
        shoulders = (at["left_shoulder"] + at["right_shoulder"]) / 2
        self.chest = shoulders - at["spine3"]
        self.sole = DEFAULT_BODY.sole_offset * size_of(skeleton)
        self.rise = {side: at[f"{side}_ankle"][1] - at[f"{side}_foot"][1] for side in SIDES}
        legs = [self.hips[1] - at[f"{side}_foot"][1] + self.sole for side in SIDES]
        self.legs = points.legs / (sum(legs) / 2)
        self.trunk = points.at["spine3"][1] / (shoulders - self.hips)[1]
        self.lean = points.at["spine3"] - self.trunk * (shoulders - self.hips)
        apart = {side: self.legs * (at[f"{side}_hip"] - self.hips)[0] for side in SIDES}
        self.apart = {side: points.at[f"{side}_hip"][0] - apart[side] for side in SIDES}

    def scaled(
        self, joints: Float[np.ndarray, "T 22 3"], turns: dict[str, Float[np.ndarray, "T 3 3"]]
    ) -> dict[str, Float[np.ndarray, "T 3"]]:
        """All 22 joints, and `hips`, from the ground under the start on; feet not planted yet, knees not bent."""
        at = {name: joints[:, i] for i, name in enumerate(self.skeleton.names)}
        robot, middle = self.points.at, (at["left_hip"] + at["right_hip"]) / 2
        hips = self.legs * middle
        chest = turns["spine3"]
        shoulders = hips + self.trunk * (at["spine3"] + chest @ self.chest - middle) + chest @ self.lean
        made = {name: hips + self.trunk * (at[name] - middle) for name in _TRUNK} | {"hips": hips}
        for side in SIDES:
            made[f"{side}_hip"] = hips + turns["pelvis"] @ robot[f"{side}_hip"]
            made[f"{side}_shoulder"] = shoulders + chest @ (robot[f"{side}_shoulder"] - robot["spine3"])
            for part, above in (("elbow", "shoulder"), ("wrist", "elbow")):
                way = at[f"{side}_{part}"] - at[f"{side}_{above}"]
                length = self.points.length(f"{side}_{part}", f"{side}_{above}")
                made[f"{side}_{part}"] = made[f"{side}_{above}"] + length * _unit(way)
            across = _unit(turns["pelvis"][:, :, 0] * [1, 0, 1])
            ankle = self.legs * at[f"{side}_ankle"] + self.apart[side] * across
            clear = np.minimum(at[f"{side}_ankle"][:, 1] - self.rise[side], at[f"{side}_foot"][:, 1]) - self.sole
            ankle[:, 1] = self.legs * clear
            made[f"{side}_ankle"] = ankle  # its sole's lowest point, until it is known how the foot is turned
            self.stood(side, made, turns[f"{side}_ankle"])
            made[f"{side}_knee"] = (made[f"{side}_hip"] + made[f"{side}_ankle"]) / 2
        return made

    def stood(self, side: str, places: dict[str, Float[np.ndarray, "T 3"]], turn: Float[np.ndarray, "T 3 3"]) -> None:
        """Raise an ankle from the height of its sole's lowest point, and put the tip of its sole."""
        places[f"{side}_ankle"][:, 1] -= self.lowest(side, turn)
        places[f"{side}_foot"] = places[f"{side}_ankle"] + turn @ self.tip(side)

    def lowest(self, side: str, turn: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, " T"]:
        """How high the lowest point of a sole is against its ankle."""
        heights: np.ndarray = np.minimum(*((turn @ end)[:, 1] for end in (self.tip(side), self.points.heels[side])))
        return heights

    def tip(self, side: str) -> Float[np.ndarray, "3"]:
        """The tip of a sole against its ankle."""
        tip: np.ndarray = self.points.at[f"{side}_foot"] - self.points.at[f"{side}_ankle"]
        return tip


_TRUNK = ("pelvis", "spine1", "spine2", "spine3", "neck", "head", "left_collar", "right_collar")


def _ground(joints: Float[np.ndarray, "T 22 3"], skeleton: Skeleton, standing: Iterable[Plant]) -> np.ndarray:
    """The ground under the hips of the first frame: as high as the ball of the foot that stands first has its sole."""
    hips = joints[0, skeleton.indices(["left_hip", "right_hip"])].mean(axis=0)
    feet = joints[:, skeleton.indices(["left_foot", "right_foot"]), 1]
    first = min((plant for plant in standing if plant.joint.endswith("foot")), key=lambda p: p.begin, default=None)
    lowest = feet.min() if first is None else first.place[1]
    return np.array([hips[0], lowest - DEFAULT_BODY.sole_offset * size_of(skeleton), hips[2]])


def _stand(
    side: str,
    places: dict[str, np.ndarray],
    turns: dict[str, np.ndarray],
    standing: Iterable[Plant],
    motion: Motion,
    body: Body,
) -> list[Plant]:
    """Level soles that stand, keep them where they stand, and tell where that is."""
    ankle, foot = f"{side}_ankle", f"{side}_foot"
    masks = {name: np.zeros(motion.frames, bool) for name in (ankle, foot)}
    stands = list[Plant]()
    for plant in standing:
        if plant.joint in masks:
            masks[plant.joint][plant.begin : plant.end] = True
    tilt = np.arccos(np.clip(turns[ankle][:, 1, 1], -1, 1))
    places[ankle][:, 1] += body.lowest(side, turns[ankle])
    flat = (masks[ankle] & (tilt < _LEVEL)) | (turns[ankle][:, 1, 2] > 0)  # on a ball that stands, no heel is lower
    turns[ankle] = _levelled(turns[ankle], masks[foot] & flat, motion.fps)
    body.stood(side, places, turns[ankle])
    moved = np.full((motion.frames, 3), np.nan)
    for begin, end in _stretches(masks[foot]):
        place = places[foot][begin:end].mean(axis=0)
        moved[begin:end] = place - places[foot][begin:end]
        stands.append(Plant(foot, begin, end, place))
    for begin, end in _stretches(masks[ankle] & ~masks[foot]):  # where the toes stand before or after, the heel joins
        near = [frame for frame in (begin - 1, end) if 0 <= frame < motion.frames and masks[foot][frame]]
        held = [places[ankle][frame] + moved[frame] for frame in near] or [places[ankle][begin:end].mean(axis=0)]
        moved[begin:end] = np.linspace(held[0], held[-1], end - begin) - places[ankle][begin:end]
        stands.append(Plant(ankle, begin, end, (held[0] + held[-1]) / 2))
    known = np.flatnonzero(np.isfinite(moved[:, 0]))
    if len(known):
        frames = np.arange(motion.frames)
        by = np.stack([np.interp(frames, known, moved[known, axis]) for axis in range(3)], axis=1)
        places[ankle], places[foot] = places[ankle] + by, places[foot] + by
    return stands


def _stretches(mask: Bool[np.ndarray, " T"]) -> list[tuple[int, int]]:
    """The first frame of every stretch, and the one after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return [(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)]


def _levelled(
    turn: Float[np.ndarray, "T 3 3"], level: Bool[np.ndarray, " T"], fps: float
) -> Float[np.ndarray, "T 3 3"]:
    """Feet turned level and one way while they stand so, and on a short way before and after."""
    stretches = _stretches(level)
    if not stretches:
        return turn
    away, (near,) = distance_transform_edt(~level, return_indices=True)
    z = _unit(turn[:, :, 2] * [1, 0, 1])
    for begin, end in stretches:
        z[begin:end] = _unit(z[begin:end].mean(axis=0))
    z = z[near]
    y = np.broadcast_to([0.0, 1.0, 0.0], z.shape)
    flat = np.stack([np.cross(y, z), y, z], axis=-1)
    share = np.clip(1 - away / max(_RAMP * fps, 1), 0, 1)
    share = share * share * (3 - 2 * share)
    by = Rotation.from_matrix(flat @ turn.transpose(0, 2, 1)).as_rotvec() * share[:, None]
    turned: np.ndarray = Rotation.from_rotvec(by).as_matrix() @ turn
    return turned


def _knee(side: str, places: dict[str, np.ndarray], turns: dict[str, np.ndarray], points: Points) -> None:
    """Bend a knee between hip and ankle, ahead of the thigh."""
    hip, ankle = places[f"{side}_hip"], places[f"{side}_ankle"]
    thigh = points.length(f"{side}_hip", f"{side}_knee")
    shin = points.length(f"{side}_knee", f"{side}_ankle")
    way = ankle - hip
    far = np.clip(np.linalg.norm(way, axis=1), abs(thigh - shin) + 1e-6, thigh + shin)[:, None]
    way = _unit(way)
    ahead = turns[f"{side}_hip"][:, :, 2]
    ahead = _unit(ahead - (ahead * way).sum(axis=1, keepdims=True) * way)
    along = (thigh**2 - shin**2 + far**2) / (2 * far)
    places[f"{side}_knee"] = hip + along * way + np.sqrt(np.maximum(thigh**2 - along**2, 0)) * ahead


def _unit(ways: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
    return ways / np.maximum(np.linalg.norm(ways, axis=-1, keepdims=True), 1e-9)


def _skeleton(rest: dict[str, np.ndarray], skeleton: Skeleton) -> Skeleton:
    """The skeleton of the T-pose of a robot."""
    offsets = [(0.0, 0.0, 0.0)]
    for parent, joint in skeleton.bones:
        x, y, z = (rest[skeleton.names[joint]][0] - rest[skeleton.names[parent]][0]).tolist()
        offsets.append((x, y, z))
    return replace(skeleton, offsets=tuple(offsets))
