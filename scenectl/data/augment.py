"""Copies of clips that stay physical: mirrored, bent, slower or faster, edited, with more rounds of what repeats."""

from __future__ import annotations

import random
from collections.abc import Sequence

import torch
from pydantic import Field

from scenectl.data.corpus import Clip, bent, mirrored, retimed
from scenectl.data.edits.walks import crouched, ducking, reaching, sidestepping
from scenectl.data.kinds import kind_of
from scenectl.data.repeat import repeated
from scenes.tables import Table

SHORTEST_EDIT = 40
"""Frames a walk needs for a pose edit to show."""
REPEATING = frozenset(
    ["walk", "run", "sneak", "hop", "squat", "exercise", "fight"]
    + [f"bandai: {content}" for content in ("walk", "walk-left", "walk-right", "walk-back", "run", "dash")]
)
"""Kinds of motion that may go on and on: a longer walk is still a walk, but two bows are not a bow."""


class Augmentation(Table):
    """Which copies are made, each switchable.

    Attributes:
        mirror: add a mirrored copy of every clip.
        bend: bent copies of every clip that travels (curvature drawn so that the path turns by up to `max_turn`).
        max_turn: radians.
        min_travel: metres a clip must travel along +z to be bent.
        max_sideways: metres a clip may leave the z axis to be bent; the map folds far from it.
        speed: each bent copy is also resampled by a factor drawn from 1/speed .. speed.
        crouch, duck, sidestep, reach: share of the walks that get a copy with this pose edit (0 to 1).
        repeat: share of the short clips of `REPEATING` kinds that get a copy which goes on for six to ten seconds.
    """

    mirror: bool = True
    bend: int = 2
    max_turn: float = 1.6
    min_travel: float = 1.0
    max_sideways: float = 1.0
    speed: float = 1.15
    crouch: float = Field(default=0.5, ge=0, le=1)
    duck: float = Field(default=0.5, ge=0, le=1)
    sidestep: float = Field(default=0.5, ge=0, le=1)
    reach: float = Field(default=0.5, ge=0, le=1)
    repeat: float = Field(default=1.0, ge=0, le=1)


def augmented(clips: Sequence[Clip], settings: Augmentation, seed: int) -> list[Clip]:
    """The clips and their copies, in a fixed order for a seed."""
    draw = random.Random(seed)
    out = list(clips)
    for clip in clips:
        out += [copy for _ in range(settings.bend) if (copy := _bent_copy(clip, settings, draw)) is not None]
    out += _edited_copies(clips, settings, draw)
    cyclic = [clip for clip in clips if kind_of(clip) in REPEATING and draw.random() < settings.repeat]
    out += [copy for clip in cyclic if (copy := repeated(clip, draw)) is not None]
    if settings.mirror:
        out += [mirrored(clip) for clip in out]
    return out


def _edited_copies(clips: Sequence[Clip], settings: Augmentation, draw: random.Random) -> list[Clip]:
    edits = {
        crouched: settings.crouch,
        ducking: settings.duck,
        sidestepping: settings.sidestep,
        reaching: settings.reach,
    }
    walks = [clip for clip in clips if _walks(clip) and clip.frames >= SHORTEST_EDIT]
    copies = (edit(clip, draw) for clip in walks for edit, share in edits.items() if draw.random() < share)
    return [copy for copy in copies if copy is not None]


def _walks(clip: Clip) -> bool:
    return kind_of(clip).removeprefix("bandai: ").split("-")[0] in ("walk", "turn")


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
