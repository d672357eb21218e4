"""The body of a character for motions of the 22 joints: radii around its bones, measured on its triangles."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch

from scenes.body.body import BodyCapsule, BodySphere, ProxyBody
from scenes.body.capsules import SAMPLES, away_from_segment, sample_surface
from scenes.body.rig import Rig
from scenes.errors import UserError
from scenes.motion.fitting import skeleton_of
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D, Skeleton

PLACED = ("spine1", "spine2", "spine3", "left_collar", "right_collar", "left_foot", "right_foot")
"""Joints that are placed by others where a character lacks them."""

THINNEST = 0.01
"""Metres below which no radius goes: thinner capsules would need thousands of samples."""

SHORTEST = 1e-3
"""Metres below which a bone has no direction."""

_AT = HUMANML3D.index


@dataclass(frozen=True)
class _Limb:
    """A bone from joint `a` to joint `b`, or the end of a limb past joint `a` (b = -1), and what lies around it."""

    a: int
    b: int
    start: np.ndarray  # [3] metres
    end: np.ndarray
    points: np.ndarray  # [n, 3] metres, of the surface that is nearest to it
    ground: float

    def radius(self, coverage: float) -> float:
        """Metres that hold a share of the points but do not reach below the ground."""
        away = away_from_segment(self.points, self.start, self.end)
        room = min(self.start[1], self.end[1]) - self.ground
        return max(THINNEST, min(float(np.quantile(away, coverage, method="higher")), float(room)))


def fit_body(rig: Rig, joints: Mapping[str, str], coverage: float | int = 1.0) -> ProxyBody:
    """Spheres and capsules on the 22 joints around a character's triangles, as it stands at rest.

    Surface belongs to the nearest bone among those that start at its joint; fingers count as the wrist, and the ends of
    limbs reach past their last joint. Bones are as long as the character's, in the T-pose whatever it rests in: arms
    that hang down only tell their lengths. The balls of the feet lie where soles are level in the T-pose (`placed`).
    Nothing reaches below the soles, or every motion would stand in the floor; `source` says how far the character
    sticks out of its body.

    Args:
        rig: the character, y up, on its feet.
        joints: {joint of the 22: link of the rig}; those in `PLACED` may be missing.
        coverage: share of the surface points around each bone that its capsule must hold, above 0.5.

    Raises:
        UserError: joints that are unknown or missing, joints in one place, or a coverage outside (0.5, 1].
    """
    if not 0.5 < coverage <= 1:
        raise UserError(f"coverage is {coverage:g}; give a share above 0.5 and at most 1")
    place = placed(rig, joints)
    limbs = _limbs(rig, joints, place)
    radii = {(limb.a, limb.b): limb.radius(coverage) for limb in limbs if len(limb.points)}
    for limb in limbs:  # a bone that no triangle is nearest to is as thick as the thinnest one beside it
        beside = [r for key, r in radii.items() if {limb.a, limb.b} & set(key) - {-1}]
        radii.setdefault((limb.a, limb.b), min(beside or radii.values()))
    how, skeleton = f"fitted to {rig.name}", t_pose(rig, place)
    on_joints = [
        BodySphere(name, j, max(r for key, r in radii.items() if j in key), how)
        for j, name in enumerate(HUMANML3D.names)
    ]
    past = [sphere for limb in limbs if limb.b < 0 for sphere in _past(limb, radii[limb.a, -1], how, skeleton)]
    bones = tuple(BodyCapsule(a, b, radii[a, b], how) for a, b in HUMANML3D.bones)
    feet = place[[_AT("left_foot"), _AT("right_foot")], 1]
    sticks_out, where = _sticks_out(limbs, radii, on_joints, place)
    source = (
        f"fitted to {rig.source}, {100 * coverage:g} % of what is around each bone; at rest the character sticks out "
        f"at most {1000 * sticks_out:.0f} mm, at the {where}"
    )
    return ProxyBody(skeleton, (*on_joints, *past), bones, float(feet.min()) - limbs[0].ground, source)


def t_pose(rig: Rig, place: np.ndarray) -> Skeleton:
    """The T-pose of a character whose joints stand at ``place [22, 3]`` at rest (`placed`)."""
    skeleton = skeleton_of(Motion(torch.from_numpy(place)[None]))
    for (parent, joint), length in zip(skeleton.bones, skeleton.bone_lengths[1:], strict=True):
        if length < SHORTEST:
            names = f"{HUMANML3D.names[parent]} and {HUMANML3D.names[joint]}"
            raise UserError(f"{names} of '{rig.name}' lie in one place; state other links for them")
    return skeleton


def fits(joints: Mapping[str, str]) -> bool:
    """Whether enough of the 22 joints are known for `fit_body`."""
    return all(name in joints or name in PLACED for name in HUMANML3D.names)


def placed(rig: Rig, joints: Mapping[str, str]) -> np.ndarray:
    """World positions of the 22 joints at rest, ``[22, 3]``.

    The ball of a foot lies over or under the joint that the character has there, as high as it is over a level sole in
    the T-pose: so feet that are turned as ours stand on level soles, however high their ankles are.
    """
    at = {_AT(joint): rig.origins[rig.index(link)] for joint, link in joints.items()}
    missing = [name for name in HUMANML3D.names if _AT(name) not in at and name not in PLACED]
    if missing:
        raise UserError(f"no link of '{rig.name}' is stated for {', '.join(missing)}; state which is which")
    spine = [_AT(name) for name in ("pelvis", *PLACED[:3], "neck")]
    shares = np.cumsum([0.0, *HUMANML3D.bone_lengths[spine[1:]]])
    known = [k for k, joint in enumerate(spine) if joint in at]
    for k, joint in enumerate(spine):
        between = [np.interp(shares[k], shares[known], [at[spine[i]][axis] for i in known]) for axis in range(3)]
        at.setdefault(joint, np.array(between))
    left = at[_AT("left_hip")] - at[_AT("right_hip")]
    facing = np.array([-left[2], 0.0, left[0]]) / max(math.hypot(left[0], left[2]), SHORTEST)
    for side in ("left", "right"):
        at.setdefault(_AT(f"{side}_collar"), (at[_AT("neck")] + at[_AT(f"{side}_shoulder")]) / 2)
        ankle, foot = _AT(f"{side}_ankle"), _AT(f"{side}_foot")
        _, down, ahead = HUMANML3D.offsets[foot]
        shin = np.linalg.norm(at[ankle] - at[_AT(f"{side}_knee")]) / HUMANML3D.bone_lengths[ankle]
        at.setdefault(foot, at[ankle] + shin * ahead * facing)
        along = math.hypot(*(at[foot] - at[ankle])[[0, 2]])
        at[foot] = np.array([at[foot][0], at[ankle][1] + along * down / ahead, at[foot][2]])
    return np.stack([at[j] for j in range(len(HUMANML3D.names))])


def _limbs(rig: Rig, joints: Mapping[str, str], place: np.ndarray) -> list[_Limb]:
    """All bones and ends of limbs with the vertices, and points between them, that are nearest to each."""
    surface: dict[int, list[np.ndarray]] = {}
    for part in rig.parts:
        some = np.concatenate([part.placed, sample_surface(part.placed, part.faces, SAMPLES)])
        surface.setdefault(_joint_of(rig, part.link, joints), []).append(some)
    leaves = sorted(set(range(len(place))) - {a for a, _ in HUMANML3D.bones})
    ends = {bone: place[bone[1]] for bone in HUMANML3D.bones} | {(leaf, -1): place[leaf] for leaf in leaves}
    around: dict[tuple[int, int], list[np.ndarray]] = {key: [np.zeros((0, 3))] for key in ends}
    for joint, parts in surface.items():
        points = np.concatenate(parts)
        if joint in leaves:
            around[joint, -1].append(points)
            ends[joint, -1] = _tip(points, place[joint], place[HUMANML3D.parents[joint]])
            continue
        bones = _bones_of(joint, joints)
        nearest = np.argmin([away_from_segment(points, place[a], place[b]) for a, b in bones], axis=0)
        for k, bone in enumerate(bones):
            around[bone].append(points[nearest == k])
    ground = float(rig.triangles[..., 1].min())
    return [_Limb(a, b, place[a], ends[a, b], np.concatenate(around[a, b]), ground) for a, b in ends]


def _bones_of(joint: int, joints: Mapping[str, str]) -> list[tuple[int, int]]:
    """Bones that start at a joint, and those that start at joints without a link of their own after it."""
    found = []
    for a, b in HUMANML3D.bones:
        if a == joint:
            found += [(a, b), *(() if HUMANML3D.names[b] in joints else _bones_of(b, joints))]
    return found


def _joint_of(rig: Rig, link: str, joints: Mapping[str, str]) -> int:
    """The joint of the 22 that a link moves with: its own or the nearest above, else the pelvis."""
    named = {link: _AT(joint) for joint, link in joints.items()}
    index = rig.index(link)
    while index >= 0 and rig.links[index] not in named:
        index = rig.parents[index]
    return named[rig.links[index]] if index >= 0 else _AT("pelvis")


def _tip(points: np.ndarray, joint: np.ndarray, parent: np.ndarray) -> np.ndarray:
    """Where the segment through the end of a limb stops, so that a round cap ends where the limb does."""
    bone = joint - parent
    length = float(np.linalg.norm(bone))
    if length < 1e-6:
        raise UserError("the last two joints of a limb lie in one place; state other links for them")
    along = (points - joint) @ bone / length
    side = np.linalg.norm(points - joint - along[:, None] * bone / length, axis=1)
    tip: np.ndarray = joint + max(0.0, float(along.max() - side.max())) * bone / length
    return tip


def _past(limb: _Limb, radius: float, how: str, skeleton: Skeleton) -> list[BodySphere]:
    """Spheres from the last joint to the end of a limb, at most a radius apart."""
    base = HUMANML3D.parents[limb.a]
    reach = float(np.linalg.norm(limb.end - limb.start))
    count = math.ceil(reach / radius - 1e-9)
    name, bone = HUMANML3D.names[limb.a], float(skeleton.bone_lengths[limb.a])
    return [
        BodySphere(f"{name}_end_{k + 1}", limb.a, radius, how, base, reach * (k + 1) / count / bone)
        for k in range(count)
    ]


def _sticks_out(
    limbs: list[_Limb], radii: Mapping[tuple[int, int], float], spheres: list[BodySphere], place: np.ndarray
) -> tuple[float, str]:
    """The farthest (m) that a point lies outside all capsules and spheres, and the nearest joint's name."""
    points = np.concatenate([limb.points for limb in limbs])
    away = [away_from_segment(points, limb.start, limb.end) - radii[limb.a, limb.b] for limb in limbs]
    away += [np.linalg.norm(points - place[sphere.joint], axis=1) - sphere.radius for sphere in spheres]
    outside = np.min(away, axis=0)
    worst = int(outside.argmax())
    nearest = int(np.linalg.norm(place - points[worst], axis=1).argmin())
    return max(0.0, float(outside[worst])), HUMANML3D.names[nearest]
