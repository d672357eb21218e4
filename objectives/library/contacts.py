"""Parts of the body that rest on or against something."""

from __future__ import annotations

from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from objectives.context import Context, Parted
from objectives.marks import Mark
from objectives.maths import length
from objectives.parameters import NotNegative, Point
from objectives.registry import Masked, goal
from scenes.errors import UserError
from scenes.motion.motion import Motion

Part = Literal["seat", "back", "left_hand", "right_hand", "left_foot", "right_foot"]
"""Parts of the body that can be in contact."""
OWNERS: dict[str, tuple[str, ...]] = {
    "seat": ("pelvis", "left_hip", "right_hip", "left_knee", "right_knee"),
    "back": ("spine1", "spine2", "spine3"),
    "left_hand": ("left_wrist",),
    "right_hand": ("right_wrist",),
    "left_foot": ("left_ankle", "left_foot"),
    "right_foot": ("right_ankle", "right_foot"),
}
"""Joints whose samples of the proxy body belong to each; a knee's are those of the lower thigh."""
_MOMENT = 0.1
"""Seconds over which a slide is measured, so that it is a length."""
_OVER = 0.2
"""Metres from a stated point within which the part's middle is over it: half the width of a chair."""


@goal(
    unit="m", kernel="squared", reduction="mean", scale=200.0, tolerance=0.03,
    supports=lambda parameters: OWNERS[parameters["part"]], local=True,
)  # fmt: skip
def contact(
    motion: Motion,
    context: Context,
    *,
    part: Part,
    surface: str | None = None,
    position: Point | None = None,
    slide: NotNegative = 0.1,
    within: NotNegative = 0.0,
) -> Masked:
    """Rest a part of the body on or against a surface: seat and thighs on a chair, a hand on a table.

    Three residuals, m, of d = min over the part's samples m of phi(p_m) - r_m: max(0, d - within), how far the nearest
    is from the surface; max(0, -d - give), how deep the deepest is in it, beyond what a soft part of the scene gives;
    and how far the part slides over it in 0.1 s, beyond `slide`. Ours; no paper states it. The scale is that of
    `joint_target`.

    Args:
        part: "seat", "back", or a hand or foot.
        surface: name of a part of the scene; by default all of it.
        position: a point of the surface, world m, that the part's middle is over or before, within 0.2 m.
        slide: speed over the surface that is free, m/s.
        within: distance from the surface that is as good, m: large while the part is on its way there, when it need
            not touch but shall not go in.

    Raises:
        UserError: a part of the body without samples, or a name that the scene does not know.
    """
    points, radius = context.body.points(motion)
    chosen = [i for i, owner in enumerate(context.body.owners) if owner in OWNERS[part]]
    if not chosen:
        raise UserError(f"no sample of the body belongs to its {part.replace('_', ' ')}")
    points, radius = points[..., chosen, :], radius[chosen].to(points)
    room = _distance(context, surface, points, motion.times[:, None]) - radius
    nearest, middle = room.amin(-1), points.mean(-2)
    moved = length(middle.diff(dim=-2)) - slide / motion.fps
    slid = torch.nn.functional.pad(moved.clamp_min(0) * (_MOMENT * motion.fps), (0, 1))
    steps = torch.nn.functional.pad(motion.valid[..., 1:] & motion.valid[..., :-1], (0, 1))
    give = 0.0 if surface is None else context.give(surface)
    parts = [(nearest - within).clamp_min(0), (-nearest - give).clamp_min(0), slid]
    active, labels, targets = [motion.valid, motion.valid, steps], ["gap", "depth", "slide"], None
    place = None if position is None else middle.new_tensor(position)
    if place is not None:
        parts.append((length(middle - place) - _OVER).clamp_min(0))
        active, labels = [*active, motion.valid], [*labels, "place"]
        free = torch.full_like(place, torch.nan)
        targets = torch.stack([free, free, free, place]).expand(*middle.shape[:-1], 4, 3)

    def marks() -> list[Mark]:
        touching = Mark("ball", middle.detach()[:, None], float(radius.max()), times=motion.times)
        return [touching] if place is None else [touching, Mark("ball", place[None])]

    return Masked(
        torch.stack(parts, dim=-1), torch.stack(active, dim=-1), labels=[f"{part} ({what})" for what in labels],
        joints=[OWNERS[part][0]] * len(parts), points=middle[..., None, :].expand(*middle.shape[:-1], len(parts), 3),
        targets=targets, marks=marks,
    )  # fmt: skip


@goal(unit="m", kernel="squared", reduction="mean", scale=200.0, tolerance=0.03, local=True)
def support(
    motion: Motion,
    context: Context,
    *,
    parts: list[Part] = ["left_foot", "right_foot", "seat", "left_hand", "right_hand"],  # noqa: B006  (read only)
) -> Masked:
    """Be carried at any time by some part of the body, whichever it is.

    Its residual is max(0, min_m phi(p_m) - r_m), m, over the samples m of all parts: how far the nearest is from
    anything. Ours; no paper states it. The scale is that of `joint_target`.

    Args:
        parts: which can carry.

    Raises:
        UserError: no part, or one without samples.
    """
    owners = {joint for part in parts for joint in OWNERS[part]}
    points, radius = context.body.points(motion)
    chosen = [i for i, owner in enumerate(context.body.owners) if owner in owners]
    if not chosen:
        raise UserError("no sample of the body belongs to 'parts'; name some that can carry")
    points, radius = points[..., chosen, :], radius[chosen].to(points)
    nearest = (context.scene.distance(points, motion.times[:, None]) - radius).min(-1)
    at = nearest.indices[..., None, None].expand(*nearest.indices.shape, 1, 3)
    names = ["the part that is nearest to something"]
    return Masked(nearest.values.clamp_min(0)[..., None], labels=names, points=points.gather(-2, at))


def _distance(
    context: Context, surface: str | None, points: Float[Tensor, "*b 3"], times: Tensor
) -> Float[Tensor, "*b"]:
    """Signed distance (m) to a named part of the scene, or to all of it."""
    if surface is None:
        return context.scene.distance(points, times)
    if not isinstance(context.scene, Parted):
        raise UserError("this scene has no named parts; leave out 'surface'")
    return context.scene.part(surface).distance(points, times)
