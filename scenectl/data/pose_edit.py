"""Pose edits by foot-locked inverse kinematics: a walk becomes a crouched, ducking, side-stepping or reaching one.

The pelvis and the trunk move, the feet stay where they are planted, and the legs (or an arm) follow by the closed form
for two bones. Joint positions in the canonical frame, metres; bone lengths are kept.
"""

from __future__ import annotations

import math
import random
from dataclasses import replace

import torch
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from torch import Tensor

from scenectl.data.corpus import Clip
from scenectl.data.features import FPS, to_uniform_skeleton
from scenes.motion.headings import across
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D

_SIDES = ("left", "right")
_LEGS = [HUMANML3D.indices([f"{side}_{part}" for part in ("hip", "knee", "ankle", "foot")]) for side in _SIDES]
_ARMS = {side: HUMANML3D.indices([f"{side}_{part}" for part in ("shoulder", "elbow", "wrist")]) for side in _SIDES}
_SPINE, _NECK = HUMANML3D.indices(("pelvis", "spine1", "spine2")), HUMANML3D.index("neck")
_STRAIGHT = 0.998
"""Largest share of a limb's length that an edit stretches it to."""
_SUNK = 0.005
"""How far (m) an edit may bring a joint below the floor of its clip."""


def crouched(clip: Clip, draw: random.Random) -> Clip | None:
    """The clip with bent knees and a trunk that leans forward, all the way through."""
    depth = draw.uniform(0.1, 0.32)
    how = draw.choice(["in a crouch", "while crouching low", "with bent knees, crouched"])
    envelope = clip.joints.new_ones(clip.frames)
    return _edited(clip, "crouch", how, _lowered(clip.joints, depth * envelope, 1.6 * depth * envelope))


def ducking(clip: Clip, draw: random.Random) -> Clip | None:
    """The clip with a duck somewhere in it, as under a bar."""
    depth = draw.uniform(0.2, 0.42)
    envelope = _bump(clip.joints, draw, hold=(0.2, 0.7))
    if envelope is None:
        return None
    how = draw.choice(["and ducks under something", "and ducks down on the way", "ducking under a bar"])
    return _edited(clip, "duck", how, _lowered(clip.joints, depth * envelope, 2.0 * depth * envelope))


def sidestepping(clip: Clip, draw: random.Random) -> Clip | None:
    """A straight walk led off to one side while the body goes on facing forward."""
    pelvis = clip.joints[:, 0]
    travel, sideways = float(pelvis[-1, 2] - pelvis[0, 2]), float(pelvis[:, 0].abs().max())
    if travel < 1.0 or sideways > 0.35 * travel:
        return None
    angle, side = draw.uniform(0.5, math.pi / 2), draw.choice(_SIDES)
    # The more sideways, the shorter: long steps would cross the legs.
    stride = 1.0 - 0.65 * math.sin(angle) ** 2
    across = stride * math.sin(angle) * (1.0 if side == "left" else -1.0)
    ground = clip.joints * clip.joints.new_tensor([0.0, 0.0, 1.0])
    shift = ground[..., 2:] * clip.joints.new_tensor([across, 0.0, stride * math.cos(angle) - 1.0])
    joints = _with_legs(clip.joints, shift[:, 0], torch.stack([shift[:, foot] for *_, foot in _LEGS], dim=1))
    way = f"to the {side}" if angle > 1.2 else f"diagonally to the {side}, facing forward"
    copy = _edited(clip, "sidestep", "", joints)
    return copy and replace(copy, captions=(f"a person sidesteps {way}.", f"someone steps sideways {way}."))


def reaching(clip: Clip, draw: random.Random) -> Clip | None:
    """The clip with one hand stretched out to something for a moment."""
    side = draw.choice(_SIDES)
    height, where = draw.choice([(-0.35, "down"), (0.0, "forward"), (0.45, "up")])
    envelope = _bump(clip.joints, draw, hold=(0.3, 1.0))
    if envelope is None:
        return None
    outwards = draw.uniform(-0.1, 0.25) * (1.0 if side == "left" else -1.0)
    offset = clip.joints.new_tensor([outwards, height + draw.uniform(-0.12, 0.12), draw.uniform(0.3, 0.5)])
    lean = 0.35 * envelope if where == "down" else 0.1 * envelope
    bowed = _lowered(clip.joints, 0.25 * lean, lean)
    how = f"and reaches {where} with the {side} hand"
    return _edited(clip, "reach", how, _with_arm(bowed, side, offset, envelope))


def _edited(clip: Clip, name: str, how: str, joints: Float[Tensor, "T 22 3"]) -> Clip | None:
    """The clip with new joints, or None where the edit broke a bone or went through the floor."""
    wrong = float((to_uniform_skeleton(joints) - joints).abs().max())
    if not bool(torch.isfinite(joints).all()) or wrong > 2e-3 or float(joints[..., 1].min()) < -_SUNK:
        return None
    captions = tuple(f"{text.rstrip('.')} {how}." for text in clip.captions)
    return replace(clip, id=f"{clip.id}~{name}", joints=joints, captions=captions, label=f"{clip.label}, {name}")


def _bump(
    joints: Float[Tensor, "T 22 3"], draw: random.Random, hold: tuple[float, float]
) -> Float[Tensor, " T"] | None:
    """0, smoothly up to 1, held, down again, somewhere inside the clip; None where the clip is too short."""
    rise, still = draw.uniform(0.45, 0.7) * FPS, draw.uniform(*hold) * FPS
    slack = len(joints) - 1 - 2 * rise - still
    if slack < 0:
        return None
    begin = draw.uniform(0.0, slack)
    t = torch.arange(len(joints), dtype=torch.float32, device=joints.device) - begin
    ramp = torch.minimum(t / rise, (2 * rise + still - t) / rise).clamp(0.0, 1.0)
    return ramp**3 * (ramp * (6 * ramp - 15) + 10)


def _lowered(
    joints: Float[Tensor, "T 22 3"], depth: Float[Tensor, " T"], pitch: Float[Tensor, " T"]
) -> Float[Tensor, "T 22 3"]:
    """The body `depth` metres lower and its trunk `pitch` radians further forward, over the same feet."""
    left, forward = _axes(joints)
    # The seat goes back as the chest comes forward, or the body would topple.
    shift = torch.stack([torch.zeros_like(depth), -depth, torch.zeros_like(depth)], -1) - 0.3 * depth[:, None] * forward
    leant = _pitched(joints, left, pitch)
    return _with_legs(leant, shift, joints.new_zeros(len(joints), 2, 3))


def _axes(joints: Float[Tensor, "T 22 3"]) -> tuple[Float[Tensor, "T 3"], Float[Tensor, "T 3"]]:
    """Level unit vectors to the person's left and forward, by hips and shoulders."""
    left = across(Motion(joints))
    left = left * left.new_tensor([1.0, 0.0, 1.0])
    left = left / left.norm(dim=-1, keepdim=True).clamp_min(1e-6)
    return left, torch.linalg.cross(left, left.new_tensor([[0.0, 1.0, 0.0]]).expand_as(left))


def _pitched(
    joints: Float[Tensor, "T 22 3"], left: Float[Tensor, "T 3"], pitch: Float[Tensor, " T"]
) -> Float[Tensor, "T 22 3"]:
    """The trunk bent forward in three places, head and arms turned most of the way back."""
    joints = joints.clone()
    for pivot in _SPINE:
        _rotate(joints, pivot, _above(pivot), left, pitch / len(_SPINE))
    _rotate(joints, _NECK, _above(_NECK), left, -0.6 * pitch)
    for arm in _ARMS.values():
        _rotate(joints, arm[0], _above(arm[0]), left, -0.8 * pitch)
    return joints


def _above(joint: int) -> list[int]:
    """Joints that hang on this one, the legs left out."""
    found = {joint}
    for child, parent in enumerate(HUMANML3D.parents):
        if parent in found and child not in (_LEGS[0][0], _LEGS[1][0]):
            found.add(child)
    return sorted(found - {joint})


def _rotate(joints: Tensor, pivot: int, moved: list[int], axis: Tensor, angle: Tensor) -> None:
    """Turn joints about a pivot in place (Rodrigues)."""
    arm = joints[:, moved] - joints[:, pivot, None]
    k = axis[:, None].expand_as(arm)
    c, s = angle.cos()[:, None, None], angle.sin()[:, None, None]
    along = (k * arm).sum(-1, keepdim=True)
    joints[:, moved] = joints[:, pivot, None] + arm * c + torch.linalg.cross(k, arm) * s + k * along * (1 - c)


def _with_legs(
    joints: Float[Tensor, "T 22 3"], body: Float[Tensor, "T 3"], feet: Float[Tensor, "T 2 3"]
) -> Float[Tensor, "T 22 3"]:
    """The body moved by one shift and each foot by its own; knees solved, the body lower where a leg is too short."""
    hips, ankles = [leg[0] for leg in _LEGS], [leg[2] for leg in _LEGS]
    length = _STRAIGHT * float(sum(HUMANML3D.bone_lengths[j] for j in _LEGS[0][1:3]))
    reach = joints[:, hips] + body[:, None] - joints[:, ankles] - feet
    level = reach[..., [0, 2]].square().sum(-1)
    spare = reach[..., 1] - (length**2 - level).clamp_min(0.0).sqrt()
    drop = spare.amax(1).clamp_min(0.0).cpu().numpy()
    if drop.max() > 0:
        drop = gaussian_filter1d(maximum_filter1d(drop, 9), 2.0)
    body = body - torch.as_tensor(drop, device=body.device)[:, None] * body.new_tensor([0.0, 1.0, 0.0])
    moved = joints + body[:, None]
    _, forward = _axes(joints)
    for s, (hip, knee, ankle, foot) in enumerate(_LEGS):
        for joint in (ankle, foot):
            moved[:, joint] = joints[:, joint] + feet[:, s]
        bent = _perpendicular(joints[:, knee] - joints[:, hip], joints[:, ankle] - joints[:, hip])
        toes = joints[:, foot] - joints[:, ankle]
        toes = toes * toes.new_tensor([1.0, 0.0, 1.0])
        # A leg that was straight does not say where its knee points; its toes and the body do.
        pole = bent + 0.3 * toes + 0.02 * forward
        moved[:, knee] = _middle(moved[:, hip], moved[:, ankle], pole, knee, ankle)
    return moved


def _with_arm(
    joints: Float[Tensor, "T 22 3"], side: str, offset: Float[Tensor, "3"], envelope: Float[Tensor, " T"]
) -> Float[Tensor, "T 22 3"]:
    """The wrist led along an arc to `offset` (left, up, forward; m) from the shoulder, as far as `envelope` says."""
    shoulder, elbow, wrist = _ARMS[side]
    left, forward = _axes(joints)
    up = joints.new_tensor([0.0, 1.0, 0.0])
    goal = offset[0] * left + offset[1] * up + offset[2] * forward
    now = joints[:, wrist] - joints[:, shoulder]
    length = _STRAIGHT * float(HUMANML3D.bone_lengths[elbow] + HUMANML3D.bone_lengths[wrist])
    a, b = now.norm(dim=-1, keepdim=True), goal.norm(dim=-1, keepdim=True)
    between = ((now / a) * (goal / b)).sum(-1, keepdim=True).clamp(-0.999, 0.999).acos()
    share = envelope[:, None]
    direction = (((1 - share) * between).sin() * now / a + (share * between).sin() * goal / b) / between.sin()
    arm = direction * torch.lerp(a, b.clamp_max(length), share)
    out = joints.clone()
    out[:, wrist] = joints[:, shoulder] + arm
    bent = _perpendicular(joints[:, elbow] - joints[:, shoulder], now)
    outwards = left if side == "left" else -left
    pole = torch.lerp(bent, 0.1 * (outwards - up), share)
    out[:, elbow] = _middle(out[:, shoulder], out[:, wrist], pole, elbow, wrist)
    return out


def _perpendicular(vector: Tensor, axis: Tensor) -> Tensor:
    axis = axis / axis.norm(dim=-1, keepdim=True).clamp_min(1e-6)
    return vector - (vector * axis).sum(-1, keepdim=True) * axis


def _middle(root: Tensor, end: Tensor, pole: Tensor, first: int, second: int) -> Tensor:
    """Joint between two bones (those that end in joints `first` and `second`), on the side of `pole`."""
    upper, lower = float(HUMANML3D.bone_lengths[first]), float(HUMANML3D.bone_lengths[second])
    way = end - root
    distance = way.norm(dim=-1, keepdim=True).clamp(abs(upper - lower) + 1e-4, upper + lower)
    along = (upper**2 - lower**2 + distance**2) / (2 * distance)
    aside = (upper**2 - along**2).clamp_min(0.0).sqrt()
    pole = _perpendicular(pole, way)
    pole = pole / pole.norm(dim=-1, keepdim=True).clamp_min(1e-6)
    return root + along * way / way.norm(dim=-1, keepdim=True).clamp_min(1e-6) + aside * pole
