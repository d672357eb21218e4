"""Rotations of joints, and the joints that they carry.

A joint's rotation turns, with the joint, everything that hangs on it: with rotations R (world) and offsets o of the
skeleton's T-pose, a joint stands at ``p[parent] + R[parent] @ o[joint]``. Positions leave open how a bone turns about
itself. It is decided so:

- Where several bones leave a joint (hips and spine the pelvis, neck and collars the chest) they alone decide
  (`scenes.motion.rigid.turns`). Joints of a spine between two such turn as those do, by their share of the way.
- Thighs and upper arms turn so that knee and elbow bend in one plane with them: a knee backward, an elbow forward as
  it lies in the T-pose. The straighter the limb, the less its plane says; then it counts how the limb bends within the
  second around, and in the end how its bone would have come from the T-pose on the shortest way. So a limb may be
  straight, or bent a little the wrong way, and does not flip.
- All other bones come from where their parents carry them on the shortest way: shins and forearms (for which that is
  a turn of the hinge), collars, necks, and feet by their toes.
- Wrists, toes and the head turn as their parents do, and so does what has no bone to tell.

Skeletons of other names have no knees and elbows to look for: their limbs come on the shortest way.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from scenes.motion.motion import Motion
from scenes.motion.rigid import Branch, tree_of, turns
from scenes.motion.rotations import axes, matrices, rotation_between, steady, unit_quaternions
from scenes.motion.skeleton import Skeleton

HINGES = {
    "left_hip": ("left_knee", "left_ankle", (1.0, 0.0, 0.0)),
    "right_hip": ("right_knee", "right_ankle", (1.0, 0.0, 0.0)),
    "left_shoulder": ("left_elbow", "left_wrist", (0.0, -1.0, 0.0)),
    "right_shoulder": ("right_elbow", "right_wrist", (0.0, 1.0, 0.0)),
}
"""By the joint that a limb turns about: its hinge, its end, and the axis about which the hinge bends in the T-pose."""
_STRAIGHT = 0.2
"""Sine of the bend (12 degrees) at which its plane counts as much as the shortest way."""
_AROUND = 0.5
"""Of what a frame's own plane counts, those around it do together."""
_MEMORY = 0.25
"""Seconds over which planes count e times less."""


def orientations(motion: Motion) -> Float[Tensor, "*b T J 3 3"]:
    """How every joint is turned in the world, against the T-pose; differentiable in the joints."""
    joints, skeleton, tree = motion.joints, motion.skeleton, tree_of(motion.skeleton)
    bones = torch.cat([joints[..., :1, :] * 0, joints[..., 1:, :] - joints[..., tree.parents, :]], dim=-2)
    turned = {
        branch.joint: turns(bones[..., [bone + 1 for bone in branch.bones], :], branch) for branch in tree.branches
    }
    between = _between(skeleton, {branch.joint: branch for branch in tree.branches})
    world = torch.eye(3).to(joints).expand(*joints.shape[:-2], 3, 3)
    for joint, parent in enumerate(skeleton.parents):
        if joint in turned:
            continue
        above = turned[parent] if parent >= 0 else world
        ends = [end for end, over in enumerate(skeleton.parents) if over == joint and skeleton.bone_lengths[end] > 0]
        if joint in between:
            first, last, share = between[joint]
            above = torch.lerp(turned[first], turned[last], share)
        if not ends:
            turned[joint] = above
            continue
        rest, bone = joints.new_tensor(skeleton.offsets[ends[0]]), bones[..., ends[0], :]
        if joint in between:
            across = torch.eye(3).to(joints)[rest.abs().argmin()]
            turned[joint] = axes(bone, above @ across) @ axes(rest, across).mT
            continue
        turned[joint] = rotation_between(above @ rest, bone) @ above
        if skeleton.names[joint] in HINGES and set(HINGES[skeleton.names[joint]][:2]) <= set(skeleton.names):
            _, end, axis = HINGES[skeleton.names[joint]]
            lower = bones[..., skeleton.index(end), :]
            turned[joint] = _bent(turned[joint], bone, lower, joints.new_tensor(axis), rest, motion)
    return torch.stack([turned[joint] for joint in range(len(skeleton.names))], dim=-3)


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


def _bent(
    swung: Float[Tensor, "*b T 3 3"],
    upper: Float[Tensor, "*b T 3"],
    lower: Float[Tensor, "*b T 3"],
    axis: Float[Tensor, "3"],
    rest: Float[Tensor, "3"],
    motion: Motion,
) -> Float[Tensor, "*b T 3 3"]:
    """A limb's rotation, turned about its upper bone until the hinge bends in its plane."""
    along, beyond = (bone / (bone.square().sum(-1, keepdim=True) + 1e-12).sqrt() for bone in (upper, lower))
    first = swung @ axis
    second = torch.linalg.cross(along, first)
    normal = torch.linalg.cross(along, beyond)
    normal = normal * normal.square().sum(-1, keepdim=True)
    seen = torch.stack([(normal * first).sum(-1), (normal * second).sum(-1)], dim=-1) * motion.valid[..., None]
    seen = seen + _around(seen, motion.fps) + seen.new_tensor([_STRAIGHT**3, 0.0])
    across = seen[..., :1] * first + seen[..., 1:] * second
    return axes(upper, across) @ axes(rest, axis).mT


def _around(seen: Float[Tensor, "*b T 2"], fps: float) -> Float[Tensor, "*b T 2"]:
    """What the frames around each have seen, the near ones most."""
    size = 2 * seen.shape[-2]
    away = torch.arange(size, dtype=seen.dtype, device=seen.device)
    kernel = torch.exp(-torch.minimum(away, size - away) / (_MEMORY * fps))
    total = 1 / math.tanh(0.5 / (_MEMORY * fps))  # over all time, so that more frames change nothing in these
    spectrum = torch.fft.rfft(kernel * (_AROUND / total))[:, None] * torch.fft.rfft(seen, size, dim=-2)
    return torch.fft.irfft(spectrum, size, dim=-2)[..., : seen.shape[-2], :]


def local_rotations(motion: Motion) -> Float[Tensor, "*b T J 4"]:
    """Unit quaternions (w, x, y, z) of every joint against its parent, the root's in the world; continuous in time."""
    turned = orientations(motion)
    above = turned[..., tree_of(motion.skeleton).parents, :, :]
    local = torch.cat([turned[..., :1, :, :], above.mT @ turned[..., 1:, :, :]], dim=-3)
    return steady(unit_quaternions(local))


def forward(
    rotations: Float[Tensor, "*b J 4"], root: Float[Tensor, "*b 3"], skeleton: Skeleton
) -> Float[Tensor, "*b J 3"]:
    """Joints (m) of local rotations and the root's position (m); differentiable."""
    local, offsets = matrices(rotations), rotations.new_tensor(skeleton.offsets)
    turned, places = [local[..., 0, :, :]], [root]
    for joint, parent in enumerate(skeleton.parents[1:], 1):
        turned.append(turned[parent] @ local[..., joint, :, :])
        places.append(places[parent] + turned[parent] @ offsets[joint])
    return torch.stack(places, dim=-2)
