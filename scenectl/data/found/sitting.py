"""Halves of takes in which someone sits: going down, seated, coming up. Labels or captions say that it is a seat."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from scenectl.data.corpus import Act, Clip
from scenectl.data.features import FPS
from scenectl.data.found.holding import SHORTEST_REST, held
from scenectl.data.found.pieces import SHORTEST, drawn_for, piece, said, widened
from scenectl.data.found.traits import Traits, runs
from scenectl.data.sentences import in_one

_WORDS = re.compile(r"\bsit|\bseat|\bsat\b|\bstool|\bchair", re.IGNORECASE)
"""A squat and a seat that is not there look the same."""
_SETTLED = 16
"""Frames of standing before and of sitting after that a piece goes on for."""
_LOW = 1.0
"""Pelvis of someone who sits (m); higher is a climb onto something."""
_STILL = 0.6
"""Fastest joint (m/s) of someone who sits still."""
HOLDS, LONGER = (60, 200), (20, 70)
"""Frames that sitting is held for; of it that are shown beyond `_SETTLED`, in a second piece where there are any."""

DOWN = (
    "sits down", "sits down on a {seat}", "takes a seat", "lowers the body onto a {seat}", "is sitting down",
    "bends the knees and sits down on a {seat}", "goes from standing to sitting",
)  # fmt: skip
SEATED = (
    "sits", "sits on a {seat}", "is sitting", "is seated on a {seat}", "sits still", "remains seated", "sits and waits",
    "sits quietly on a {seat}", "stays seated", "rests on a {seat}",
)  # fmt: skip
UP = (
    "stands up", "stands up from a {seat}", "gets up from a {seat}", "rises from a {seat}", "is standing up",
    "gets up", "leans forward and stands up from a {seat}", "goes from sitting to standing",
)  # fmt: skip


def sits(clip: Clip) -> Iterator[Clip]:
    """Every sitting of a clip: down, seated and held, up, and where it has two of these the whole with its acts."""
    if not _WORDS.search(" ".join((clip.label, *clip.captions))):
        return
    traits = Traits.of(clip.joints)
    low = (traits.height < min(_LOW, traits.height.max() - 0.08)) | (traits.height.max() < 0.7)
    seated = low & (traits.thighs > 45) & (traits.speed < 0.2) & (np.abs(np.gradient(traits.height)) * FPS < 0.15)
    sittings = runs(seated, 4, gap=8)
    edges = [0, *(frame for sitting in sittings for frame in sitting), clip.frames]
    for i, (begin, end) in enumerate(sittings):
        yield from _sitting(clip, traits, begin, end, (edges[2 * i], edges[2 * i + 3]))


def _sitting(clip: Clip, traits: Traits, begin: int, end: int, between: tuple[int, int]) -> Iterator[Clip]:
    """Pieces of one sitting, `between` the end of the one before and the beginning of the next."""
    draw = drawn_for(clip, "sit", begin)
    height = float(traits.height[begin:end].mean())
    seat = draw.choice(
        ["stool", "high stool", "high chair"] if height > 0.68 else ["chair", "seat", "stool", "low chair"]
    )
    down, seated, up = (tuple(text.format(seat=seat) for text in texts) for texts in (DOWN, SEATED, UP))
    tall = float(traits.height.max()) - 0.06
    before, after = (traits.height[part] for part in (slice(between[0], begin + 1), slice(end - 1, between[1])))
    first, last = _standing(before[::-1], tall, begin, -1), _standing(after, tall, end - 1, 1)
    if first is not None:
        a, b = widened(max(0, first - _SETTLED), min(begin + _SETTLED, end), clip.frames)
        if b - a >= SHORTEST:
            yield piece(clip, clip.joints[a:b], "sit down", begin, said(down, draw, 5))
            if (more := min(end - b, draw.randint(*LONGER))) >= LONGER[0]:
                yield piece(clip, clip.joints[a : b + more], "sit down", begin + 1, said(down, draw, 5))
    for a, b in runs(traits.quickest[begin:end] < _STILL, SHORTEST_REST):
        for i in range(1 + (b - a) // 30):
            moving = held(clip.joints[begin + a : begin + b], draw.randint(*HOLDS), draw, sway=0.0)
            yield piece(clip, moving, "sit", begin + a + i, said(seated, draw, 5))
    if last is not None:
        a, b = widened(max(end - _SETTLED, begin), min(clip.frames, last + _SETTLED), clip.frames)
        if b - a >= SHORTEST:
            yield piece(clip, clip.joints[a:b], "stand up", end, said(up, draw, 5))
            if (more := min(a - begin, draw.randint(*LONGER))) >= LONGER[0]:
                yield piece(clip, clip.joints[a - more : b], "stand up", end + 1, said(up, draw, 5))
    if first is not None and last is not None and end - begin >= SHORTEST_REST:
        a, b = max(0, first - 6), min(clip.frames, last + 6)
        edges = (0, begin - a, end - a, b - a)
        texts = (said(each, draw, 4) for each in (down, seated, up))
        acts = [Act(x, y, t) for x, y, t in zip(edges[:-1], edges[1:], texts, strict=True)]
        yield piece(clip, clip.joints[a:b], "composed", begin, in_one([act.captions for act in acts]), acts)


def _standing(height: np.ndarray, tall: float, at: int, way: int) -> int | None:
    """Frame at which someone stands who sits at the first of these heights; None where the clip ends before."""
    top = height[: 3 * int(FPS)].max()
    if top < max(tall, height[0] + 0.08):
        return None
    return at + way * int(np.flatnonzero(height > top - 0.04)[0])
