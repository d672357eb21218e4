"""Copies of clips that stay physical: mirrored, bent paths, other speeds."""

from __future__ import annotations

import random
from collections.abc import Sequence

import torch
from pydantic import BaseModel, ConfigDict

from scenectl.data.corpus import Clip, bent, mirrored, retimed


class Augmentation(BaseModel):
    """Which copies are made, each switchable.

    Attributes:
        mirror: add a mirrored copy of every clip.
        bend: bent copies of every clip that travels (curvature drawn so that the path turns by up to `max_turn`).
        max_turn: radians.
        min_travel: metres a clip must travel along +z to be bent.
        max_sideways: metres a clip may leave the z axis to be bent; the map folds far from it.
        speed: each bent copy is also resampled by a factor drawn from 1/speed .. speed.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    mirror: bool = True
    bend: int = 2
    max_turn: float = 1.6
    min_travel: float = 1.0
    max_sideways: float = 1.0
    speed: float = 1.15


def augmented(clips: Sequence[Clip], settings: Augmentation, seed: int) -> list[Clip]:
    """The clips and their copies, in a fixed order for a seed."""
    draw = random.Random(seed)
    out = list(clips)
    for clip in clips:
        out += [copy for _ in range(settings.bend) if (copy := _bent_copy(clip, settings, draw)) is not None]
    if settings.mirror:
        out += [mirrored(clip) for clip in out]
    return out


def _bent_copy(clip: Clip, settings: Augmentation, draw: random.Random) -> Clip | None:
    pelvis = clip.joints[:, 0]
    travel = float(pelvis[:, 2].max())
    back = float(-pelvis[:, 2].min())
    sideways = float(clip.joints[..., 0].abs().max())
    turn, speed = draw.uniform(-1.0, 1.0) * settings.max_turn, settings.speed ** draw.uniform(-1.0, 1.0)
    if travel < settings.min_travel or back > 0.3 * travel or sideways > settings.max_sideways:
        return None
    curvature = turn / travel
    if abs(curvature) * sideways > 0.4:  # beyond this, one side of the body would shrink to nothing
        curvature = 0.4 / sideways * (1 if turn > 0 else -1)
    if abs(curvature) < 0.02:
        return None
    copy = retimed(bent(clip, curvature), speed)
    return copy if bool(torch.isfinite(copy.joints).all()) else None
