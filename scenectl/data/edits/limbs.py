"""What pose edits are made of: trunk, legs and arms led elsewhere by foot-locked inverse kinematics.

The pelvis and the trunk move, the feet stay where they are planted, and the legs (or an arm) follow by the closed form
for two bones. Joint positions in the canonical frame, metres; bone lengths are kept.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from torch import Tensor

from scenectl.data.corpus import Act, Clip
from scenectl.data.edits.timing import minimum_jerk
from scenectl.data.features import FPS, to_uniform_skeleton
from scenes.motion.headings import across, heading
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D

SIDES = ("left", "right")
LEGS = [HUMANML3D.indices([f"{side}_{part}" for part in ("hip", "knee", "ankle", "foot")]) for side in SIDES]
ARMS = {side: HUMANML3D.indices([f"{side}_{part}" for part in ("shoulder", "elbow", "wrist")]) for side in SIDES}
SPINE, NECK = HUMANML3D.indices(("pelvis", "spine1", "spine2")), HUMANML3D.index("neck")
STRAIGHT = 0.998
"""Largest share of a limb's length that an edit stretches it to."""
SUNK = 0.005
"""How far (m) an edit may bring a joint below the floor of its clip."""
_UP, _SHORT = 0.1, 8
"""Share of an edit from which on it shows, and frames beside it that are too few to tell of."""


_TURN, _WALKS = 0.7, ("a person walks.", "someone walks forward.")
"""Radians from which on a walk turns, and what is said of a part of it that does not."""


def edited(clip: Clip, name: str, how: str, joints: Float[Tensor, "T 22 3"]) -> Clip | None:
    """The clip with new joints, or None where the edit broke a bone or went through the floor."""
    wrong = float((to_uniform_skeleton(joints) - joints).abs().max())
    if not bool(torch.isfinite(joints).all()) or wrong > 2e-3 or float(joints[..., 1].min()) < -SUNK:
        return None
    captions = tuple(f"{text.rstrip('.')} {how}." for text in clip.captions)
    return replace(
        clip, id=f"{clip.id}~{name.replace(' ', '-')}", joints=joints, captions=captions, label=f"{clip.label}, {name}"
    )


def in_turn(clip: Clip, doing: Sequence[str], envelope: Float[Tensor, " T"]) -> tuple[Act, ...]:
    """Acts of a walk with an edit in it: what it shows anyway, what is done while the envelope is up, and the rest."""
    turned = np.unwrap(heading(Motion(clip.joints)).double().cpu().numpy())

    def way(first: int, last: int) -> tuple[str, ...]:
        # Of a walk that turns, the part that does not is a walk.
        whole, part = abs(turned[-1] - turned[0]), abs(turned[last - 1] - turned[first]) if first < last else 0.0
        return _WALKS if whole > _TURN and part < 0.5 * whole else clip.captions

    up = torch.nonzero(envelope > _UP).flatten()
    begin, end = int(up[0]), int(up[-1]) + 1
    begin, end = begin if begin >= _SHORT else 0, end if len(envelope) - end >= _SHORT else len(envelope)
    frames = len(envelope)
    parts = (Act(0, begin, way(0, begin)), Act(begin, end, tuple(doing)), Act(end, frames, way(end, frames)))
    return tuple(act for act in parts if act.begin < act.end)


def bump(joints: Float[Tensor, "T 22 3"], draw: random.Random, hold: tuple[float, float]) -> Float[Tensor, " T"] | None:
    """0, smoothly up to 1, held, down again, somewhere inside the clip; None where the clip is too short."""
    rise, still = draw.uniform(0.45, 0.7) * FPS, draw.uniform(*hold) * FPS
    slack = len(joints) - 1 - 2 * rise - still
    if slack < 0:
        return None
    begin = draw.uniform(0.0, slack)
    t = torch.arange(len(joints), dtype=torch.float32, device=joints.device) - begin
    return minimum_jerk(torch.minimum(t / rise, (2 * rise + still - t) / rise))


def lowered(
    joints: Float[Tensor, "T 22 3"], depth: Float[Tensor, " T"], pitch: Float[Tensor, " T"]
) -> Float[Tensor, "T 22 3"]:
    """The body `depth` metres lower and its trunk `pitch` radians further forward, over the same feet."""
    left, forward = axes(joints)
    # The seat goes back as the chest comes forward, or the body would topple.
    shift = torch.stack([torch.zeros_like(depth), -depth, torch.zeros_like(depth)], -1) - 0.3 * depth[:, None] * forward
    leant = pitched(joints, left, pitch)
    return with_legs(leant, shift, joints.new_zeros(len(joints), 2, 3))


def axes(joints: Float[Tensor, "T 22 3"]) -> tuple[Float[Tensor, "T 3"], Float[Tensor, "T 3"]]:
    """Level unit vectors to the person's left and forward, by hips and shoulders."""
    left = across(Motion(joints))
    left = left * left.new_tensor([1.0, 0.0, 1.0])
    left = left / left.norm(dim=-1, keepdim=True).clamp_min(1e-6)
    return left, torch.linalg.cross(left, left.new_tensor([[0.0, 1.0, 0.0]]).expand_as(left))


def pitched(
    joints: Float[Tensor, "T 22 3"], left: Float[Tensor, "T 3"], pitch: Float[Tensor, " T"]
) -> Float[Tensor, "T 22 3"]:
    """The trunk bent forward in three places, head and arms turned most of the way back."""
    joints = joints.clone()
    for pivot in SPINE:
        rotate(joints, pivot, _above(pivot), left, pitch / len(SPINE))
    rotate(joints, NECK, _above(NECK), left, -0.6 * pitch)
    for arm in ARMS.values():
        rotate(joints, arm[0], _above(arm[0]), left, -0.8 * pitch)
    return joints


def _above(joint: int) -> list[int]:
    """Joints that hang on this one, the legs left out."""
    found = {joint}
    for child, parent in enumerate(HUMANML3D.parents):
        if parent in found and child not in (LEGS[0][0], LEGS[1][0]):
            found.add(child)
    return sorted(found - {joint})


def rotate(joints: Tensor, pivot: int, moved: list[int], axis: Tensor, angle: Tensor) -> None:
    """Turn joints about a pivot in place (Rodrigues)."""
    arm = joints[:, moved] - joints[:, pivot, None]
    k = axis[:, None].expand_as(arm)
    c, s = angle.cos()[:, None, None], angle.sin()[:, None, None]
    along = (k * arm).sum(-1, keepdim=True)
    joints[:, moved] = joints[:, pivot, None] + arm * c + torch.linalg.cross(k, arm) * s + k * along * (1 - c)


def with_legs(
    joints: Float[Tensor, "T 22 3"],
    body: Float[Tensor, "T 3"],
    feet: Float[Tensor, "T 2 3"],
    straight: float = STRAIGHT,
) -> Float[Tensor, "T 22 3"]:
    """The body moved by one shift and each foot by its own; knees solved, the body lower where a leg is too short."""
    hips, ankles = [leg[0] for leg in LEGS], [leg[2] for leg in LEGS]
    length = straight * float(sum(HUMANML3D.bone_lengths[j] for j in LEGS[0][1:3]))
    reach = joints[:, hips] + body[:, None] - joints[:, ankles] - feet
    level = reach[..., [0, 2]].square().sum(-1)
    spare = reach[..., 1] - (length**2 - level).clamp_min(0.0).sqrt()
    drop = spare.amax(1).clamp_min(0.0).cpu().numpy()
    if drop.max() > 0:
        drop = gaussian_filter1d(maximum_filter1d(drop, 9), 2.0)
    body = body - torch.as_tensor(drop, device=body.device)[:, None] * body.new_tensor([0.0, 1.0, 0.0])
    moved = joints + body[:, None]
    _, forward = axes(joints)
    for s, (hip, knee, ankle, foot) in enumerate(LEGS):
        for joint in (ankle, foot):
            moved[:, joint] = joints[:, joint] + feet[:, s]
        bent = perpendicular(joints[:, knee] - joints[:, hip], joints[:, ankle] - joints[:, hip])
        toes = joints[:, foot] - joints[:, ankle]
        toes = toes * toes.new_tensor([1.0, 0.0, 1.0])
        # A leg that was straight does not say where its knee points; its toes and the body do.
        pole = bent + 0.3 * toes + 0.02 * forward
        moved[:, knee] = middle(moved[:, hip], moved[:, ankle], pole, knee, ankle)
    return moved


def with_arm(
    joints: Float[Tensor, "T 22 3"],
    side: str,
    offset: Float[Tensor, "*T 3"],
    envelope: Float[Tensor, " T"],
    back: float = 0.0,
) -> Float[Tensor, "T 22 3"]:
    """The wrist led along an arc to `offset` (left, up, forward; m) from the shoulder, as far as `envelope` says.

    The elbow goes outwards and down, and `back` times as far back.
    """
    shoulder, elbow, wrist = ARMS[side]
    left, forward = axes(joints)
    up = joints.new_tensor([0.0, 1.0, 0.0])
    goal = offset[..., :1] * left + offset[..., 1:2] * up + offset[..., 2:] * forward
    now = joints[:, wrist] - joints[:, shoulder]
    length = STRAIGHT * float(HUMANML3D.bone_lengths[elbow] + HUMANML3D.bone_lengths[wrist])
    a, b = now.norm(dim=-1, keepdim=True), goal.norm(dim=-1, keepdim=True)
    between = ((now / a) * (goal / b)).sum(-1, keepdim=True).clamp(-0.999, 0.999).acos()
    share = envelope[:, None]
    direction = (((1 - share) * between).sin() * now / a + (share * between).sin() * goal / b) / between.sin()
    arm = direction * torch.lerp(a, b.clamp_max(length), share)
    out = joints.clone()
    out[:, wrist] = joints[:, shoulder] + arm
    bent = perpendicular(joints[:, elbow] - joints[:, shoulder], now)
    outwards = left if side == "left" else -left
    pole = torch.lerp(bent, 0.1 * (outwards - up - back * forward), share)
    out[:, elbow] = middle(out[:, shoulder], out[:, wrist], pole, elbow, wrist)
    return out


def perpendicular(vector: Tensor, axis: Tensor) -> Tensor:
    """What of a vector is across an axis."""
    axis = axis / axis.norm(dim=-1, keepdim=True).clamp_min(1e-6)
    return vector - (vector * axis).sum(-1, keepdim=True) * axis


def middle(root: Tensor, end: Tensor, pole: Tensor, first: int, second: int) -> Tensor:
    """Joint between two bones (those that end in joints `first` and `second`), on the side of `pole`."""
    upper, lower = float(HUMANML3D.bone_lengths[first]), float(HUMANML3D.bone_lengths[second])
    way = end - root
    distance = way.norm(dim=-1, keepdim=True).clamp(abs(upper - lower) + 1e-4, upper + lower)
    along = (upper**2 - lower**2 + distance**2) / (2 * distance)
    aside = (upper**2 - along**2).clamp_min(0.0).sqrt()
    pole = perpendicular(pole, way)
    pole = pole / pole.norm(dim=-1, keepdim=True).clamp_min(1e-6)
    return root + along * way / way.norm(dim=-1, keepdim=True).clamp_min(1e-6) + aside * pole


TRUNK = (0.17, 0.13)
"""Half width and half depth (m) around the spine that a hand led elsewhere stays out of: the trunk of the proxy body
(`scenes.body.body`: capsules of up to 0.13 m, hips 0.1 m aside) and the thickness of a wrist."""
WRISTS = (20, 21)


def chest(
    joints: Float[Tensor, "T 22 3"],
) -> tuple[Float[Tensor, "T 3"], Float[Tensor, "T 3"], Float[Tensor, "T 3"]]:
    """Unit vectors to the left, up and forward of the chest, however it leans."""
    up = joints[:, NECK] - joints[:, SPINE[0]]
    up = up / up.norm(dim=-1, keepdim=True).clamp_min(1e-6)
    left = perpendicular(joints[:, ARMS["left"][0]] - joints[:, ARMS["right"][0]], up)
    left = left / left.norm(dim=-1, keepdim=True).clamp_min(1e-6)
    return left, up, torch.linalg.cross(left, up)


def turned_trunk(joints: Float[Tensor, "T 22 3"], axis: Tensor, angle: Float[Tensor, " T"]) -> Float[Tensor, "T 22 3"]:
    """The trunk turned about an axis in three places: about the vertical towards a side, about forward sideways."""
    joints = joints.clone()
    for pivot in SPINE:
        rotate(joints, pivot, _above(pivot), axis.expand(len(joints), 3), angle / len(SPINE))
    return joints


def with_hand(
    joints: Float[Tensor, "T 22 3"], side: str, goal: Float[Tensor, "T 3"], pole: Float[Tensor, "T 3"]
) -> Float[Tensor, "T 22 3"]:
    """The wrist at a place in the world, or as near as the arm is long, the elbow on the side of `pole`."""
    shoulder, elbow, wrist = ARMS[side]
    length = STRAIGHT * float(HUMANML3D.bone_lengths[elbow] + HUMANML3D.bone_lengths[wrist])
    arm = goal - joints[:, shoulder]
    distance = arm.norm(dim=-1, keepdim=True).clamp_min(1e-6)
    out = joints.clone()
    out[:, wrist] = joints[:, shoulder] + arm * (distance.clamp(0.1, length) / distance)
    out[:, elbow] = middle(out[:, shoulder], out[:, wrist], pole, elbow, wrist)
    return out


def elbow_side(joints: Float[Tensor, "T 22 3"], side: str, led: Float[Tensor, " T"]) -> Float[Tensor, "T 3"]:
    """Which way the elbow lies from the line between shoulder and wrist, as a unit vector.

    An arm that is nearly straight does not say, and captures of one may bend it backwards: around where it is `led`
    away, its elbow is behind it and outwards.
    """
    shoulder, elbow, wrist = ARMS[side]
    bent = perpendicular(joints[:, elbow] - joints[:, shoulder], joints[:, wrist] - joints[:, shoulder])
    left, _, forward = chest(joints)
    # Before the arm bends, when an elbow that goes to the other side goes a few centimetres.
    soon = gaussian_filter1d(maximum_filter1d((led > 0.002).float().cpu().numpy(), 17), 3.0)
    doubt = 4 * (0.06 - bent.norm(dim=-1, keepdim=True)).clamp_min(0.0) * led.new_tensor(soon)[:, None]
    pole = bent + doubt * ((left if side == "left" else -left) - forward)
    return pole / pole.norm(dim=-1, keepdim=True).clamp_min(1e-6)


def clear_of_trunk(joints: Float[Tensor, "T 22 3"], goal: Float[Tensor, "T 3"]) -> Float[Tensor, "T 3"]:
    """A path of a hand led round the trunk (`TRUNK`), where it would go through."""
    left, up, forward = chest(joints)
    arm = goal - joints[:, SPINE[0]]
    height = joints[:, NECK] - joints[:, SPINE[0]]
    inside = (arm * up).sum(-1)
    level = ((inside + 0.1) / 0.1).clamp(0, 1) * ((height.norm(dim=-1) + 0.05 - inside) / 0.1).clamp(0, 1)
    x, z = (arm * left).sum(-1) / TRUNK[0], (arm * forward).sum(-1) / TRUNK[1]
    radius = (x.square() + z.square()).sqrt().clamp_min(0.05)
    push = level * (1 / radius - 1).clamp_min(0.0)
    away = push[:, None] * (x[:, None] * TRUNK[0] * left + z[:, None] * TRUNK[1] * forward)
    return goal + away.new_tensor(gaussian_filter1d(away.cpu().numpy(), 1.5, axis=0)) if bool(push.any()) else goal
