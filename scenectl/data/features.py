"""HumanML3D's 263 features a frame: from joints, and back, differentiably.

Layout (Guo et al. 2022, HumanML3D): half the yaw step (1, rad), root displacement x z (2, m/frame), root
height (1, m), positions of joints 1..21 (63, m), their 6D rotations (126), displacements of joints 0..21
(66, m/frame), contacts of left ankle, left foot, right ankle, right foot (4). Everything but heights is
seen from the heading frame. T frames of joints give T - 1 rows.
"""

from __future__ import annotations

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from scenes.errors import UserError
from scenes.motion.headings import heading_across, heading_of, rotation_about_y
from scenes.motion.rigid import on_bones
from scenes.motion.rotations import rotated, rotation_between
from scenes.motion.skeleton import FEET, HUMANML3D

FEATURES = 263
FPS = 20.0
JOINTS = 22

YAW = slice(0, 1)
ROOT_VELOCITY = slice(1, 3)
ROOT_HEIGHT = slice(3, 4)
POSITIONS = slice(4, 67)
ROTATIONS = slice(67, 193)
VELOCITIES = slice(193, 259)
CONTACTS = slice(259, 263)
GROUPS = (YAW, ROOT_VELOCITY, ROOT_HEIGHT, POSITIONS, ROTATIONS, VELOCITIES, CONTACTS)

CONTACT_JOINTS = ("left_ankle", "left_foot", "right_ankle", "right_foot")
CONTACT_THRESHOLD = 0.002
"""Squared displacement (m^2) between frames below which a foot joint counts as in contact."""

HEADING_SIGMA = 20.0
"""Width in frames of the Gaussian that smooths the heading over time."""

# Chains along which HumanML3D solves its inverse kinematics; the arms start at the upper spine.
_CHAINS = ((0, 2, 5, 8, 11), (0, 1, 4, 7, 10), (0, 3, 6, 9, 12, 15), (9, 14, 17, 19, 21), (9, 13, 16, 18, 20))
# Directions of bones in the rest pose of HumanML3D's rotations: arms hang, feet point forward.
_X, _Y, _Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
_BACK, _DOWN = (-1, 0, 0), (0, -1, 0)
_REST = (
    *((0, 0, 0), _X, _BACK, _Y, _DOWN, _DOWN, _Y, _DOWN, _DOWN, _Y, _Z, _Z, _Y, _X, _BACK, _Z),
    *(_DOWN, _DOWN, _DOWN, _DOWN, _DOWN, _DOWN),
)
_LEFT_HIP, _RIGHT_HIP, _LEFT_SHOULDER, _RIGHT_SHOULDER = 1, 2, 16, 17


def joints_to_features(joints: Float[Tensor, "T 22 3"]) -> Float[Tensor, "T-1 263"]:
    """Features of one clip at 20 fps.

    The clip is first put on the floor, over the origin and facing +z (`canonicalise`); its bones are taken
    as they are (`to_uniform_skeleton` gives them HumanML3D's lengths).

    Args:
        joints: positions, metres, y up.

    Raises:
        UserError: fewer than two frames, or positions that are not finite.
    """
    if joints.shape[0] < 2:
        raise UserError(f"a clip of {joints.shape[0]} frame(s) has no features; at least 2 are needed")
    if not torch.isfinite(joints).all():
        raise UserError("a clip holds joint positions that are not finite")
    joints = canonicalise(joints)
    heading = smoothed_heading(joints)
    unturn = rotation_about_y(-heading)  # world to heading frame, [T, 3, 3]
    root = joints[:, 0]
    yaw = -torch.remainder(heading[1:] - heading[:-1] + torch.pi, 2 * torch.pi) + torch.pi
    root_step = rotated(unturn[1:], root[1:] - root[:-1])[:, [0, 2]]
    ground = root * root.new_tensor([1.0, 0.0, 1.0])
    local = rotated(unturn[:, None], joints - ground[:, None])
    step = joints[1:] - joints[:-1]
    feet = HUMANML3D.indices(CONTACT_JOINTS)
    contact = step[:, feet].square().sum(-1) < CONTACT_THRESHOLD
    return torch.cat(
        [
            yaw[:, None] / 2,
            root_step,
            root[:-1, 1:2],
            local[:-1, 1:].flatten(1),
            _rotations_6d(joints, unturn)[:-1].flatten(1),
            rotated(unturn[:-1, None], step).flatten(1),
            contact.to(joints),
        ],
        dim=-1,
    )


def features_to_joints(features: Float[Tensor, "*b T c"]) -> Float[Tensor, "*b T 22 3"]:
    """Joint positions in the canonical frame (metres), differentiable; the last row's yaw and velocity go unused.

    Only the features up to the joints' positions are read, the first 67; others may be missing.
    """
    half_turns = F.pad(features[..., YAW].squeeze(-1)[..., :-1].cumsum(-1), (1, 0))
    turn = rotation_about_y(-2 * half_turns)
    x, z = features[..., ROOT_VELOCITY][..., :-1, :].unbind(-1)
    # The displacement in row t-1 is seen from the heading of frame t, hence the shift by one.
    moved = rotated(turn[..., 1:, :, :], torch.stack([x, torch.zeros_like(x), z], dim=-1))
    ground = F.pad(moved.cumsum(-2), (0, 0, 1, 0))
    local = features[..., POSITIONS].unflatten(-1, (JOINTS - 1, 3))
    others = rotated(turn[..., None, :, :], local) + ground[..., None, :]
    up = features.new_tensor([0.0, 1.0, 0.0])
    root = ground + features[..., ROOT_HEIGHT] * up
    return torch.cat([root[..., None, :], others], dim=-2)


def body_joints(features: Float[Tensor, "*b T c"]) -> Float[Tensor, "*b T 22 3"]:
    """`features_to_joints` of what a network made, on the rigid bones that all steps put bodies on."""
    return on_bones(features_to_joints(features), HUMANML3D)


def on_body(features: Float[Tensor, "*b T c"]) -> Float[Tensor, "*b T c"]:
    """Features whose joints stand on the rigid bones of a generated body (`scenes.motion.rigid`).

    Recorded people have hips and collars in other places. Their bones keep their directions here, and so knees bend as
    they did; bodies are raised or lowered as a whole until feet are, in the mean over the window, as high as they were.
    Heights, positions and displacements change; rotations and contacts stay as they are.
    """
    zero = torch.zeros_like(features[..., :1])
    others = features[..., POSITIONS].unflatten(-1, (JOINTS - 1, 3))
    root = torch.cat([zero, features[..., ROOT_HEIGHT], zero], dim=-1)
    local = torch.cat([root[..., None, :], others], dim=-2)
    placed = on_bones(local, HUMANML3D)
    feet = HUMANML3D.indices(FEET)
    lift = (local - placed)[..., feet, 1].mean((-2, -1), keepdim=True)
    placed = placed + lift[..., None] * features.new_tensor([0.0, 1.0, 0.0])
    out = features.clone()
    out[..., ROOT_HEIGHT], out[..., POSITIONS] = placed[..., 0, 1:2], placed[..., 1:, :].flatten(-2)
    moved = placed - local
    ahead = rotated(rotation_about_y(-2 * features[..., :-1, 0])[..., None, :, :], moved[..., 1:, :, :])
    out[..., :-1, VELOCITIES] += (ahead - moved[..., :-1, :, :]).flatten(-2)
    return out


def canonicalise(joints: Float[Tensor, "T 22 3"]) -> Float[Tensor, "T 22 3"]:
    """Lowest joint of the clip at y = 0, first pelvis over the origin, first frame facing +z."""
    root = joints[0, 0]
    lowest = joints[..., 1].min()
    joints = joints - torch.stack([root[0], lowest, root[2]])
    facing = heading_across(-_across(joints[:1], swapped=False))
    return rotated(rotation_about_y(-facing)[:, None], joints)


def to_uniform_skeleton(joints: Float[Tensor, "T 22 3"]) -> Float[Tensor, "T 22 3"]:
    """The clip with HumanML3D's bone lengths: bone directions kept, root path scaled by the ratio of leg lengths."""
    parents = HUMANML3D.parents
    lengths = HUMANML3D.bone_lengths
    legs = (5, 8)  # the lengths that HumanML3D compares: shin and thigh of the right leg
    own = sum(float((joints[0, j] - joints[0, parents[j]]).norm()) for j in legs)
    scale = sum(float(lengths[j]) for j in legs) / max(own, 1e-6)
    placed = [joints[:, 0] * scale]
    for j in range(1, JOINTS):
        bone = joints[:, j] - joints[:, parents[j]]
        bone = bone / bone.norm(dim=-1, keepdim=True).clamp_min(1e-8)
        placed.append(placed[parents[j]] + bone * float(lengths[j]))
    return torch.stack(placed, dim=1)


def smoothed_heading(joints: Float[Tensor, "T 22 3"]) -> Float[Tensor, " T"]:
    """Heading of every frame, radians about +y, smoothed over time; 0 at the first frame by definition.

    HumanML3D takes the hips the wrong way round here (and only here); published features and statistics
    carry that, so it is kept.
    """
    from scipy.ndimage import gaussian_filter1d  # 0.2 s to import, and generating motions needs none of it

    across = _across(joints, swapped=True)
    across = across / across.norm(dim=-1, keepdim=True).clamp_min(1e-8)
    forward = torch.stack([across[:, 2], torch.zeros_like(across[:, 0]), -across[:, 0]], dim=-1)
    smooth = gaussian_filter1d(forward.detach().cpu().numpy(), HEADING_SIGMA, axis=0, mode="nearest")
    smooth_forward = torch.from_numpy(np.ascontiguousarray(smooth)).to(joints)
    heading = heading_of(smooth_forward)
    return torch.cat([torch.zeros_like(heading[:1]), heading[1:]])


def _across(joints: Float[Tensor, "T 22 3"], *, swapped: bool) -> Float[Tensor, "T 3"]:
    """Vector from left to right through hips and shoulders."""
    hips = joints[:, _RIGHT_HIP] - joints[:, _LEFT_HIP]
    return (-hips if swapped else hips) + joints[:, _RIGHT_SHOULDER] - joints[:, _LEFT_SHOULDER]


def _rotations_6d(joints: Float[Tensor, "T 22 3"], unturn: Float[Tensor, "T 3 3"]) -> Float[Tensor, "T 21 6"]:
    """First two columns of each joint's rotation relative to the one before it in its chain.

    The first joint of every chain, arms included, has the inverse heading as its parent.
    """
    rest = torch.as_tensor(_REST, dtype=joints.dtype, device=joints.device)
    out: list[Tensor | None] = [None] * JOINTS
    for chain in _CHAINS:
        before = unturn
        for parent, joint in zip(chain[:-1], chain[1:], strict=True):
            now = rotation_between(rest[joint].expand(len(joints), 3), joints[:, joint] - joints[:, parent])
            relative = before.transpose(-1, -2) @ now
            out[joint] = torch.cat([relative[..., 0], relative[..., 1]], dim=-1)
            before = now
    return torch.stack([rotation for rotation in out[1:] if rotation is not None], dim=1)


_MIRROR = [0, 2, 1, 3, 5, 4, 6, 8, 7, 9, 11, 10, 12, 14, 13, 15, 17, 16, 19, 18, 21, 20]


def mirror(joints: Float[Tensor, "*b 22 3"]) -> Float[Tensor, "*b 22 3"]:
    """The same motion by a person whose left and right are exchanged."""
    return joints[..., _MIRROR, :] * joints.new_tensor([-1.0, 1.0, 1.0])
