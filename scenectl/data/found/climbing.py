"""Steps climbed and come down, where labels or captions speak of steps or stairs."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
from scipy.ndimage import gaussian_filter1d

from scenectl.data.corpus import Clip
from scenectl.data.features import FPS
from scenectl.data.found.pieces import drawn_for, piece, said, widened
from scenectl.data.found.traits import PELVIS, runs

_WORDS = re.compile(r"stair|\bclimb\w* (?:\w+ )*steps?\b|\bsteps? (?:up|down|onto)\b", re.IGNORECASE)
"""A slope looks much the same to a pelvis."""
_RISE = 0.15
"""What someone climbs or comes down at least, m: a step."""
_PAUSE = 22
"""Frames between two steps of one climb at most."""
_PAD = 12

UP = (
    "climbs {steps}", "walks up {steps}", "goes up {steps}", "climbs up {steps}", "makes the way up {steps}",
    "is walking up {steps}", "ascends {steps}", "goes upstairs",
)  # fmt: skip
DOWN = (
    "climbs down {steps}", "walks down {steps}", "goes down {steps}", "comes down {steps}",
    "makes the way down {steps}", "is walking down {steps}", "descends {steps}", "goes downstairs",
)  # fmt: skip


def climbs(clip: Clip) -> Iterator[Clip]:
    """Every way up and every way down of a clip."""
    if not _WORDS.search(" ".join((clip.label, *clip.captions))):
        return
    height = gaussian_filter1d(clip.joints[:, PELVIS, 1].double().numpy(), 5.0, mode="nearest")
    rate = np.gradient(height) * FPS
    for way, texts in ((1, UP), (-1, DOWN)):
        for begin, end in runs(way * rate > 0.12, 6, gap=_PAUSE):
            rise = way * (height[end - 1] - height[begin])
            if rise < _RISE:
                continue
            a, b = widened(max(0, begin - _PAD), min(clip.frames, end + _PAD), clip.frames)
            draw = drawn_for(clip, "climb", begin)
            many: tuple[str, ...] = ("a few steps", "some steps", "the steps", "the stairs", "a short flight of stairs")
            if rise > 0.5 and re.search(r"\b(3|three) steps", clip.label):
                many = ("three steps", *many)
            captions = said(
                [text.format(steps=draw.choice(many if rise > 0.3 else ("a step",))) for text in texts], draw, 6
            )
            yield piece(clip, clip.joints[a:b], "climb", begin, captions)
