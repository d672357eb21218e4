"""The body and the scene: no penetration, and feet that touch the ground."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from objectives.context import Context
from objectives.library._joints import Joints, chosen
from objectives.maths import within
from objectives.parameters import NotNegative, Window
from objectives.registry import Masked, goal
from scenes.errors import UserError, did_you_mean
from scenes.motion.motion import Motion
from scenes.world.contact import swept_clearance

_PROBE = 0.01
"""Metres further up at which a foot is asked about again, to tell whether what is nearest lies under it."""
_UPWARD = math.cos(math.radians(25.0))
"""Share of that by which it is then further from ground: of slopes up to 20 degrees, and 5 for distances on a grid."""


@goal(unit="m", kernel="linear", reduction="mean", tolerance=0.02, local=True)
def sdf_penetration(
    motion: Motion,
    context: Context,
    *,
    margin: NotNegative = 0.0,
    exempt: Joints = [],  # noqa: B006  (read only)
    exempt_windows: list[Window] | None = None,
    touches: dict[str, list[Window]] = {},  # noqa: B006  (read only)
) -> Masked:
    """Keep the proxy body out of the scene, floor included.

    MSCoT Eq. 45 and 46: d_m = phi(p_m) - r_m for the proxy's M sample points, L = 1/(T M) sum_t sum_m max(0, -d_m),
    here max(0, margin - d_m). What is exempted counts neither in the sum nor in the mean.

    Args:
        margin: distance that shall stay free between body and scene, m; the paper has none. The ground may be stood on:
            of what is lower than the margin over that under it, no more is asked than that.
        exempt: joints whose part of the body may touch the scene, such as a hand that reaches into a shelf.
        exempt_windows: the exemption holds only in these [begin, end] (s); without `exempt` it is the whole body's.
        touches: further joints whose part of the body may touch the scene, each with windows of its own, s.
    """
    points, radius = context.body.points(motion)
    # The time axis lines up with T, so that fields which move are asked at the moment of each frame.
    distance = context.scene.distance(points, motion.times[:, None])
    radius = radius.to(distance)
    room = distance - radius
    depth = (_asked(margin, points, points[..., 1] - radius, room, context) - room).clamp_min(0)
    active = _counted(motion, context.body.owners, chosen(exempt, motion), exempt_windows, touches)
    return Masked(depth, active.expand(depth.shape), labels=context.body.owners, points=points)


@goal(unit="cm", kernel="linear", reduction="mean", scale=0.01, tolerance=2.0)
def swept_penetration(
    motion: Motion,
    context: Context,
    *,
    margin: NotNegative = 0.0,
    speed: NotNegative = 0.0,
    exempt: Joints = [],  # noqa: B006  (read only)
    exempt_windows: list[Window] | None = None,
    touches: dict[str, list[Window]] = {},  # noqa: B006  (read only)
) -> Masked:
    """Keep the body's capsules out of the scene on their way from each frame to the next, thin walls included.

    Residual: max(0, margin - room), cm, of whole capsules whose ends move straight from frame to frame, where
    `sdf_penetration` looks at samples of the body at the frames only (`scenes.world.contact.swept_clearance`, to 5 mm).
    The cost is in metres all the same, and so takes the same weights.

    Args:
        margin: distance that shall stay free between body and scene, m; of the floor as for `sdf_penetration`.
        speed: the fastest that anything in the scene moves, m/s.
        exempt: joints whose part of the body may touch the scene.
        exempt_windows: the exemption holds only in these [begin, end] (s); without `exempt` it is the whole body's.
        touches: further joints whose part of the body may touch the scene, each with windows of its own, s.
    """
    a, b, radius, owners = context.body.segments(motion)
    now, then = slice(None, -1), slice(1, None)
    ends = (a[..., now, :, :], b[..., now, :, :], a[..., then, :, :], b[..., then, :, :])
    times = (motion.times[now, None], motion.times[then, None])
    room = swept_clearance(context.scene, *ends, radius, times, speed, tolerance=0.005, enough=margin)
    lowest = torch.stack([end[..., 1] for end in ends]).amin(0) - radius
    depth = 100 * (_asked(margin, (a[..., now, :, :] + b[..., now, :, :]) / 2, lowest, room, context) - room).clamp_min(
        0
    )
    counted = _counted(motion, owners, chosen(exempt, motion), exempt_windows, touches)
    active = (counted[now] & counted[then]) & (motion.valid[..., now, None] & motion.valid[..., then, None])
    # Frame t stands for the step from t to t + 1, so the last frame of a motion has none.
    depth = torch.nn.functional.pad(depth, (0, 0, 0, 1))
    return Masked(depth, torch.nn.functional.pad(active, (0, 0, 0, 1)), labels=owners, points=(a + b) / 2)


def _asked(
    margin: float,
    places: Float[Tensor, "*b 3"],
    bottoms: Float[Tensor, "*b"],
    room: Float[Tensor, "*b"],
    context: Context,
) -> float | Float[Tensor, "*b"]:
    """The margin (m); of parts of the body whose lowest point (m, world) is lower over the ground, only that much.

    Only parts that have less than the margin are asked about: of the others, no residual is left.
    """
    close = room.detach() < margin
    if not margin or not close.any():
        return margin
    soles = torch.stack([places[..., 0], bottoms, places[..., 2]], dim=-1).detach()[close]
    ground = context.ground_under(soles)
    if ground is None:
        return margin
    return torch.full_like(bottoms, margin).masked_scatter(close, (bottoms[close] - ground).clamp(0.0, margin))


def _counted(
    motion: Motion,
    owners: list[str],
    exempt: list[str],
    windows: list[tuple[float, float]] | None,
    touches: Mapping[str, list[tuple[float, float]]],
) -> Bool[Tensor, "T M"]:
    """Which samples count in which frames."""
    motion.skeleton.indices([*exempt, *touches])  # an unknown joint is an error, not an exemption of nothing
    for name in (*exempt, *touches):
        if name not in owners:
            raise UserError(f"no part of the body belongs to joint '{name}'{did_you_mean(name, owners)}")
    everything = not exempt and windows is not None
    free = _frames(motion, windows)[:, None] & _samples(motion, owners, None if everything else exempt)
    for name, when in touches.items():
        free |= _frames(motion, when)[:, None] & _samples(motion, owners, [name])
    return ~free


def _frames(motion: Motion, windows: list[tuple[float, float]] | None) -> Bool[Tensor, " T"]:
    """Frames in any of some windows; all of them for None."""
    frames = torch.full_like(motion.times, windows is None, dtype=torch.bool)
    for window in windows or ():
        frames |= within(motion, window)
    return frames


def _samples(motion: Motion, owners: list[str], joints: list[str] | None) -> Bool[Tensor, " M"]:
    """Samples of some joints; all of them for None."""
    mine = [joints is None or owner in joints for owner in owners]
    return torch.tensor(mine, device=motion.joints.device)


@goal(unit="m", kernel="linear", reduction="mean", tolerance=0.05, local=True)
def foot_contact(
    motion: Motion,
    context: Context,
    *,
    threshold: NotNegative = 0.05,
    feet: list[str] = ["left_foot", "right_foot"],  # noqa: B006  (read only)
    each: bool = False,
) -> Masked:
    """Keep at least one foot near the ground, so that the person does not float; or each of them.

    MSCoT Eq. 47 and 48: phi_foot = min over the feet of phi(x_j), L = 1/T sum_t max(0, phi_foot - tau). The sole's
    offset is taken off phi, so that the lowest foot joint of a person at rest reads about 0. Where what is nearest is a
    wall, a riser or an edge, which hold nobody, phi is the height over the ground (`foot_heights`).

    Args:
        threshold: tau, m; the paper states no value. 0.05 because HumanML3D's foot joints are 0.048 m above the lowest
            joint on average, and in recorded walking the lower of the two exceeds 0.05 m in 5 to 20 % of frames only.
        feet: the foot joints.
        each: every one of them, as of a person who stands.
    """
    points = motion.select(feet)
    heights = foot_heights(points, motion, context)
    if each:
        return Masked((heights - threshold).clamp_min(0), labels=feet, points=points)
    height, lowest = heights.min(-1)
    where = torch.take_along_dim(points, lowest[..., None, None].expand(*lowest.shape, 1, 3), dim=-2)
    return Masked((height[..., None] - threshold).clamp_min(0), labels=["the lower foot"], points=where)


def foot_heights(points: Float[Tensor, "*b T n 3"], motion: Motion, context: Context) -> Float[Tensor, "*b T n"]:
    """Height of foot joints over what is under them less the offset of the sole, m: about 0 for a resting foot.

    That is the distance to the scene where what is nearest can be stood on: floors, slopes, and things that move.
    Walls, risers and edges hold nobody; beside them it is the height over the ground, where the scene knows it.
    """
    room, ground = context.scene.distance(points, motion.times[:, None]), context.ground_under(points)
    if ground is None:
        return room - context.body.sole_offset
    with torch.no_grad():
        higher = context.scene.distance(points + points.new_tensor([0.0, _PROBE, 0.0]), motion.times[:, None])
        holds = higher - room > _PROBE * _UPWARD
    return torch.where(holds, room, points[..., 1] - ground) - context.body.sole_offset
