"""Keeping away from spheres and capsules, which may move."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from objectives.context import Context
from objectives.library._joints import Joints, placed
from objectives.marks import Mark
from objectives.maths import length
from objectives.parameters import NotNegative, Point, Positive
from objectives.registry import Masked, goal
from objectives.tracks import Track, held_position
from scenes.motion.motion import Motion


@goal(unit="m", kernel="squared", reduction="mean", tolerance=0.0)
def sphere_repulsion(
    motion: Motion,
    context: Context,
    *,
    center: Point | Track,
    radius: Positive,
    margin: NotNegative = 0.1,
    joints: Joints | None = None,
) -> Masked:
    """Keep joints out of a sphere and a margin around it.

    MSCoT Eq. 42 and 43: d = ||x - c|| - R, L = 1/(T J) sum_t sum_j max(0, delta - d)^2. Joints are points here, as in
    the paper: choose a margin that covers the limb, or put the sphere into the scene and use `sdf_penetration`.

    Args:
        center: of the sphere, world m, or a track along which it moves (held at its ends).
        radius: of the sphere, m.
        margin: delta, the distance from the surface that shall stay free, m; the paper states no value.
        joints: which joints keep away, by default all.
    """
    names, points = placed(joints, motion)
    middle = held_position(center, motion.times)
    distance = length(points - middle) - radius
    return Masked(
        (margin - distance).clamp_min(0), labels=names, points=points,
        marks=lambda: [Mark("ball", middle, radius, "obstacle", motion.times)],
    )  # fmt: skip


@goal(unit="m", kernel="squared", reduction="mean", tolerance=0.0)
def capsule_repulsion(
    motion: Motion,
    context: Context,
    *,
    a: Point | Track,
    b: Point | Track,
    radius: Positive,
    margin: NotNegative = 0.1,
    joints: Joints | None = None,
) -> Masked:
    """Keep joints out of a capsule and a margin around it; as `sphere_repulsion` for a segment (MSCoT Eq. 42, 43).

    Args:
        a: one end of the capsule's axis, world m, or a track along which it moves (held at its ends).
        b: the other end, likewise.
        radius: of the capsule, m.
        margin: the distance from the surface that shall stay free, m.
        joints: which joints keep away, by default all.
    """
    names, points = placed(joints, motion)
    ends = held_position(a, motion.times), held_position(b, motion.times)
    distance = segment_distance(points, *ends) - radius
    return Masked(
        (margin - distance).clamp_min(0), labels=names, points=points,
        marks=lambda: [Mark("capsule", torch.cat(ends, dim=1), radius, "obstacle", motion.times)],
    )  # fmt: skip


def segment_distance(
    points: Float[Tensor, "*p d"], a: Float[Tensor, "*s d"], b: Float[Tensor, "*s d"]
) -> Float[Tensor, "*o"]:
    """Distance of points to the segments from a to b, which broadcast; a segment of no length is a point."""
    along = b - a
    share = ((points - a) * along).sum(-1) / along.square().sum(-1).clamp_min(1e-12)
    return length(points - a - along * share.clamp(0, 1)[..., None])
