"""Copies of clips that stay physical: mirrored, bent, slower or faster, edited, with more rounds of what repeats; and
what is found in clips and composed of them."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

import torch
from pydantic import Field

from scenectl.data.compose import composed
from scenectl.data.corpus import Clip, bent, mirrored, retimed
from scenectl.data.edits.carrying import carrying
from scenectl.data.edits.handling import walks
from scenectl.data.edits.lean import leaning
from scenectl.data.edits.picking import fetching, picking_up, putting_down
from scenectl.data.edits.seats import seated
from scenectl.data.edits.steps import climbing
from scenectl.data.edits.walks import crouched, ducking, reaching, sidestepping
from scenectl.data.features import FPS
from scenectl.data.found import found
from scenectl.data.kinds import kind_of
from scenectl.data.repeat import repeated
from scenectl.data.settling import settled
from scenes.tables import Table

SHORTEST_EDIT = 40
"""Frames a walk needs for a pose edit to show."""
REPEATING = frozenset(
    ["walk", "run", "sneak", "hop", "squat", "exercise", "fight"]
    + [f"bandai: {content}" for content in ("walk", "walk-left", "walk-right", "walk-back", "run", "dash")]
)
"""Kinds of motion that may go on and on: a longer walk is still a walk, but two bows are not a bow."""
JOLT = 50.0
"""m/s^2; the fastest joint of recorded people who grab and put down has 24 in the median and 65 in one take of ten."""
WALKS = {"crouch": crouched, "duck": ducking, "sidestep": sidestepping, "reach": reaching, "climb": climbing}
"""Edits of walks, by the setting that says how many of them each gets."""
ALL = {
    "reach": reaching,
    "lean": leaning,
    "seat": seated,
    "pick_up": picking_up,
    "put_down": putting_down,
    "fetch": fetching,
    "carry": carrying,
}
"""Edits that are tried on everything else, too; each takes what suits it."""
GROUPS = {"found": ("found",), "edited": (*WALKS, *ALL), "composed": ("composed",)}
"""Settings behind each group of clips that show what was not recorded, or not as a clip of its own."""
_COPIES = ("mirror", "bend", "repeat")
"""Settings behind copies that show what their recordings show."""


class Augmentation(Table):
    """What is made of recorded clips, each switchable.

    A number of edits is that of the copies that each clip is tried for, some of which come to nothing; a fraction is a
    share of the clips, so 1.5 is one copy of each and a second of half of them.

    Attributes:
        mirror: a mirrored copy of every clip, recorded, copied, found or edited; sequences mirror their pieces.
        bend: bent copies of every recorded clip that travels (the path turns by up to `max_turn`, drawn).
        max_turn: radians.
        min_travel: metres a clip must travel along +z to be bent.
        max_sideways: metres a clip may leave the z axis to be bent; the map folds far from it.
        speed: each bent copy is also resampled by a factor drawn from 1/speed .. speed.
        found: parts of recordings that show one act (`scenectl.data.found`); edits and sequences are made of them, too.
        crouch, duck, sidestep: edits of walks (`scenectl.data.edits.walks`).
        climb: walks led up or down stairs (`edits.steps`).
        reach: edits of walks and of people who stand, a hand stretched out (`edits.walks`).
        lean: people who stand and lean (`edits.lean`).
        seat: seats of other heights, of clips that sit (`edits.seats`); few do, and so each gets many.
        pick_up, put_down, fetch: hands that take a thing, put it somewhere, or bring it elsewhere (`edits.picking`).
        carry: walks and stands with a thing in the hands (`edits.carrying`).
        composed: sequences of acts (`scenectl.data.compose`), so many times as long as what was recorded.
        repeat: share of the short clips of `REPEATING` kinds that get a copy which goes on for six to ten seconds.
    """

    mirror: bool = True
    bend: int = 2
    max_turn: float = 1.6
    min_travel: float = 1.0
    max_sideways: float = 1.0
    speed: float = 1.15
    found: bool = True
    crouch: float = Field(default=0.5, ge=0)
    duck: float = Field(default=0.5, ge=0)
    sidestep: float = Field(default=1.0, ge=0)
    climb: float = Field(default=1.0, ge=0)
    reach: float = Field(default=0.5, ge=0)
    lean: float = Field(default=1.0, ge=0)
    seat: float = Field(default=20.0, ge=0)
    pick_up: float = Field(default=1.0, ge=0)
    put_down: float = Field(default=1.0, ge=0)
    fetch: float = Field(default=1.0, ge=0)
    carry: float = Field(default=0.5, ge=0)
    composed: float = Field(default=2.0, ge=0)
    repeat: float = Field(default=1.0, ge=0, le=1)

    @classmethod
    def none(cls, **but: Any) -> Augmentation:
        """No copies at all, but what is stated."""
        return cls(**(_off(*_COPIES, *chain(*GROUPS.values())) | but))

    def without(self, *groups: str) -> Augmentation:
        """The same but for some of `GROUPS`."""
        return self.model_copy(update=_off(*chain(*(GROUPS[name] for name in groups))))


def _off(*names: str) -> dict[str, Any]:
    return {name: type(Augmentation.model_fields[name].default)(0) for name in names}


def augmented(clips: Sequence[Clip], settings: Augmentation, seed: int) -> list[Clip]:
    """The clips and their copies, in a fixed order for a seed."""
    draw = random.Random(seed)
    out = list(clips)
    for clip in clips:
        out += [copy for _ in range(settings.bend) if (copy := _bent_copy(clip, settings, draw)) is not None]
    cyclic = [clip for clip in clips if kind_of(clip) in REPEATING and draw.random() < settings.repeat]
    out += [copy for clip in cyclic if (copy := repeated(clip, draw)) is not None]
    whole = [*clips, *(found(clips) if settings.found else ())]
    edited = edits(whole, settings, draw)
    out += map(settled, [*whole[len(clips) :], *edited])
    if settings.mirror:
        out += [mirrored(clip) for clip in out]
    if settings.composed:
        hours = sum(clip.frames for clip in clips) / FPS / 3600
        out += composed([*whole, *edited], draw, settings.composed * hours)
    return out


def edits(clips: Sequence[Clip], settings: Augmentation, draw: random.Random) -> list[Clip]:
    """Copies of clips with something led elsewhere: `WALKS` of walks, `ALL` of whatever suits them."""
    out = []
    for clip in clips:
        walking = walks(clip) and clip.frames >= SHORTEST_EDIT
        for name, edit in (WALKS | ALL if walking else ALL).items():
            wanted = getattr(settings, name)
            count = int(wanted) + (draw.random() < wanted % 1)
            copies = [copy for _ in range(count) if (copy := edit(clip, draw)) is not None and not jolts(copy, clip)]
            out += [replace(copy, id=f"{copy.id}-{i}") for i, copy in enumerate(copies)]
    return out


def jolts(copy: Clip, clip: Clip) -> bool:
    """Whether an edit makes a joint accelerate as the clip does nowhere."""
    before, after = (float(each.joints.diff(n=2, dim=0).norm(dim=-1).max()) * FPS**2 for each in (clip, copy))
    return after > max(1.2 * before, JOLT)


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
