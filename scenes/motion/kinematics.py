"""Rotations of joints, and the joints that they carry.

A joint's rotation turns, with the joint, everything that hangs on it: with rotations R (world) and offsets o of the
skeleton's T-pose, a joint stands at ``p[parent] + R[parent] @ o[joint]``. Positions leave open how a bone turns about
itself. It is decided so:

- Where several bones leave a joint (hips and spine the pelvis, neck and collars the chest) they alone decide
  (`scenes.motion.branches.turns`). Joints of a spine between two such turn as those do, by their share of the way.
- Thighs and upper arms turn so that knee and elbow bend in one plane with them: a knee backward, an elbow forward as
  it lies in the T-pose. The straighter the limb, the less its plane says; then it counts how the limb bends a few
  tenths of a second before and after, and in the end how its bone would come from its parent's T-pose on the shortest
  way. So a limb may be straight, or bent by up to 17 degrees the wrong way, and does not flip.
- Shins and forearms turn about the same axis as hinges do, however far they bend.
- All other bones come from where their parents carry them on the shortest way: collars, necks, and feet by their toes.
- Wrists, toes and the head turn as their parents do, and so does what has no bone to tell.

Skeletons of other names have no knees and elbows to look for: their limbs come on the shortest way.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from scenes.motion.branches import Branch, tree_of, turns
from scenes.motion.rotations import axes, matrices, rotation_between, steady, unit_quaternions
from scenes.motion.skeleton import Skeleton

HINGES = {
    "left_hip": ("left_knee", "left_ankle", (1.0, 0.0, 0.0)),
    "right_hip": ("right_knee", "right_ankle", (1.0, 0.0, 0.0)),
    "left_shoulder": ("left_elbow", "left_wrist", (0.0, -1.0, 0.0)),
    "right_shoulder": ("right_elbow", "right_wrist", (0.0, 1.0, 0.0)),
}
"""By the joint that a limb turns about: its hinge, its end, and the axis about which the hinge bends in the T-pose."""
_STRAIGHT = 0.3
"""Sine of the bend (17 degrees) at which a limb's own plane counts as much as the shortest way."""
_AROUND = 2.0
"""How often the planes of the frames around together count what a frame's own does."""
_MEMORY = 0.25
"""Seconds over which those frames count e times less. All three by `scenectl bench rotations` over all recorded clips:
of the settings tried these leave fewest turns of over 30 degrees, and upper limbs within 1.5 in the median."""


@runtime_checkable
class Moving(Protocol):
    """What is asked of a motion, which knows its own rotations (`scenes.motion.motion.Motion.rotations`)."""

    @property
    def joints(self) -> Float[Tensor, "*b T J 3"]: ...

    @property
    def valid(self) -> Bool[Tensor, "*b T"]: ...

    @property
    def fps(self) -> float: ...

    @property
    def skeleton(self) -> Skeleton: ...


def orientations(motion: Moving, names: Sequence[str] | None = None) -> Float[Tensor, "*b T n 3 3"]:
    """How joints, by default all, are turned in the world, against the T-pose, by the module's rule; differentiable.

    All of a motion decides on its limbs while they are straight; everything else is decided frame by frame.
    """
    joints, skeleton, tree = motion.joints, motion.skeleton, tree_of(motion.skeleton)
    bones = torch.cat([joints[..., :1, :], joints[..., 1:, :] - joints[..., tree.parents, :]], dim=-2)
    branches = {branch.joint: branch for branch in tree.branches}
    between, unit = _between(skeleton, branches), torch.eye(3).to(joints)
    hinges: dict[int, tuple[Tensor, Tensor]] = {}
    asked = list(range(len(skeleton.names))) if names is None else skeleton.indices(list(names))
    needed = _needed(asked, skeleton, between, branches)
    turned = {
        b.joint: turns(bones[..., [bone + 1 for bone in b.bones], :], b) for b in tree.branches if b.joint in needed
    }
    for joint, parent in enumerate(skeleton.parents):
        if joint in turned or joint not in needed:
            continue
        turned[joint] = above = turned[parent] if parent >= 0 else unit.expand(*joints.shape[:-2], 3, 3)
        if (end := _first_bone(skeleton, joint)) is None:
            continue
        bone, rest = bones[..., end, :], joints.new_tensor(skeleton.offsets[end])
        if joint in between:
            first, last, share = between[joint]
            axis = unit[rest.abs().argmin()]
            across = torch.lerp(turned[first], turned[last], share) @ axis
        elif joint in hinges:
            across, axis = hinges[joint]
        else:
            turned[joint] = rotation_between(above @ rest, bone) @ above
            limb = HINGES.get(skeleton.names[joint])
            if limb is None or limb[0] != skeleton.names[end] or limb[1] not in skeleton.names:
                continue
            lower, axis = bones[..., skeleton.index(limb[1]), :], joints.new_tensor(limb[2])
            across = _across(turned[joint] @ axis, bone, lower, motion)
            hinges[end] = across, axis
        turned[joint] = axes(bone, across) @ axes(rest, axis).mT
    return torch.stack([turned[joint] for joint in asked], dim=-3)


def _needed(
    asked: Sequence[int],
    skeleton: Skeleton,
    between: Mapping[int, tuple[int, int, float]],
    branches: Mapping[int, Branch],
) -> set[int]:
    """Joints whose rotations decide on those of others, and these."""
    needed, waiting = set[int](), list(asked)
    while waiting:
        joint = waiting.pop()
        needed.add(joint)
        waiting += between[joint][:2] if joint in between else ()
        if joint not in branches and skeleton.parents[joint] >= 0:
            waiting.append(skeleton.parents[joint])
    return needed


def _first_bone(skeleton: Skeleton, joint: int) -> int | None:
    """The joint in which the first bone ends that leaves one and has a length."""
    ends = (child for parent, child in skeleton.bones if parent == joint and skeleton.bone_lengths[child] > 0)
    return next(ends, None)


def _between(skeleton: Skeleton, branches: Mapping[int, Branch]) -> dict[int, tuple[int, int, float]]:
    """Joints on a way from one branching joint to the next: those two, and which share of the way lies behind."""
    found: dict[int, tuple[int, int, float]] = {}
    for last in branches:
        way = [last]
        while (way[0] == last or way[0] not in branches) and skeleton.parents[way[0]] >= 0:
            way.insert(0, skeleton.parents[way[0]])
        if way[0] in branches and way[0] != last:
            found |= {joint: (way[0], last, i / (len(way) - 1)) for i, joint in enumerate(way[:-1]) if i}
    return found


def _across(
    first: Float[Tensor, "*b T 3"], upper: Float[Tensor, "*b T 3"], lower: Float[Tensor, "*b T 3"], motion: Moving
) -> Float[Tensor, "*b T 3"]:
    """Directions about which a limb's hinge bends, given the one that it has where nothing tells another."""
    upper, lower = (bone / (bone.square().sum(-1, keepdim=True) + 1e-12).sqrt() for bone in (upper, lower))
    second, normal = torch.linalg.cross(upper, first), torch.linalg.cross(upper, lower)
    bend = normal.square().sum(-1, keepdim=True)  # its sine, squared
    own = torch.stack([(normal * first).sum(-1), (normal * second).sum(-1)], dim=-1) * bend
    own = torch.where(motion.valid[..., None], own, 0.0)
    others = _around(own, motion.fps) + own.new_tensor([_STRAIGHT**3, 0.0])
    told = own + (1 - bend) ** 2 * others
    return told[..., :1] * first + told[..., 1:] * second


def _around(seen: Float[Tensor, "*b T 2"], fps: float) -> Float[Tensor, "*b T 2"]:
    """What the frames around each have seen, the near ones most."""
    size = max(2 * seen.shape[-2], 2)
    away = torch.arange(size, dtype=seen.dtype, device=seen.device)
    memory = max(_MEMORY * fps, 1e-3)
    kernel = torch.exp(-torch.minimum(away, size - away) / memory)
    share = _AROUND * math.tanh(0.5 / memory)  # over the sum of such a kernel without an end
    spectrum = torch.fft.rfft(share * kernel)[:, None] * torch.fft.rfft(seen, size, dim=-2)
    return torch.fft.irfft(spectrum, size, dim=-2)[..., : seen.shape[-2], :]


def local_rotations(motion: Moving) -> Float[Tensor, "*b T J 4"]:
    """Unit quaternions (w, x, y, z) of every joint against its parent, the root's in the world; continuous in time."""
    turned = orientations(motion)
    above = turned[..., tree_of(motion.skeleton).parents, :, :]
    local = torch.cat([turned[..., :1, :, :], above.mT @ turned[..., 1:, :, :]], dim=-3)
    return steady(unit_quaternions(local))


def carried(rotations: Float[Tensor, "*b J 4"], skeleton: Skeleton) -> Float[Tensor, "*b J 3 3"]:
    """World rotations of local ones."""
    local = matrices(rotations)
    turned = [local[..., 0, :, :]]
    for joint, parent in enumerate(skeleton.parents[1:], 1):
        turned.append(turned[parent] @ local[..., joint, :, :])
    return torch.stack(turned, dim=-3)


def forward(
    rotations: Float[Tensor, "*b J 4"], root: Float[Tensor, "*b 3"], skeleton: Skeleton
) -> Float[Tensor, "*b J 3"]:
    """Joints (m) of local rotations and the root's position (m); differentiable."""
    turned, offsets = carried(rotations, skeleton), rotations.new_tensor(skeleton.offsets)
    places = [root]
    for joint, parent in enumerate(skeleton.parents[1:], 1):
        places.append(places[parent] + turned[..., parent, :, :] @ offsets[joint])
    return torch.stack(places, dim=-2)
