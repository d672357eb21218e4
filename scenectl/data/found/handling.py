"""Putting down and picking up: where hands go low or high, in clips whose labels or captions say what they do there."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
from scipy.signal import find_peaks

from scenectl.data.corpus import Clip
from scenectl.data.features import FPS
from scenectl.data.found.pieces import SHORTEST, drawn_for, piece, said, widened
from scenectl.data.found.traits import HEAD, WRISTS

_PUTS = re.compile(
    r"deposit|\bput(?:s|ting)? .*\b(?:down|on)\b|\bplac(?:e|es|ing)\b|\blay(?:s|ing)? .*\bdown\b", re.IGNORECASE
)
_PICKS = re.compile(r"\bgrab|\bpick(?:s|ing)?\b.*\bup\b|scoop", re.IGNORECASE)
_FLOOR = 0.55
"""Height (m) of a wrist whose hand reaches the floor of someone who bends down."""
_AROUND = 50
"""Frames before and after the hand is there that a piece may take."""

_PUT = {
    "floor": (
        "puts something down on the floor with the {side} hand", "bends down and puts something on the floor",
        "sets something down on the ground with the {side} hand", "places an object on the floor",
        "crouches and puts something down on the floor", "puts something down", "lays something on the ground",
    ),
    "high": (
        "puts something up high with the {side} hand", "places something on a high shelf", "puts something onto a shelf",
    ),
}  # fmt: skip
_PICK = {
    "floor": (
        "picks something up from the floor with the {side} hand", "bends down and picks something up",
        "picks up an object from the ground", "picks something up", "reaches down to the floor and picks something up",
    ),
    "high": (
        "takes something from up high with the {side} hand", "reaches up and grabs something with the {side} hand",
        "grabs something above the head", "takes something down from a high shelf",
        "stretches the {side} arm up and takes something", "reaches high up to take something",
    ),
}  # fmt: skip


def handlings(clip: Clip) -> Iterator[Clip]:
    """Every time that a hand is at the floor or above the head, with as much around it as is not another time."""
    text = " ".join((clip.label, *clip.captions))
    puts, picks = bool(_PUTS.search(text)), bool(_PICKS.search(text))
    if puts == picks:  # neither, or the motion does not say which is which
        return
    wrists = clip.joints[:, WRISTS, 1].double().numpy()
    above = wrists - clip.joints[:, HEAD, 1, None].double().numpy()
    name, texts = ("put down", _PUT) if puts else ("pick up", _PICK)
    for where, height in (("floor", -wrists), ("high", above)):
        best = height.max(1)
        limit = -_FLOOR if where == "floor" else -0.05
        peaks, _ = find_peaks(np.r_[-9.0, best, -9.0], height=limit, distance=FPS, prominence=0.2)
        peaks = peaks - 1
        if not len(peaks):
            continue
        edges = np.r_[0, (peaks[:-1] + peaks[1:]) // 2, clip.frames]
        for peak, low, high in zip(peaks.tolist(), edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            a, b = widened(max(low, peak - _AROUND), min(high, peak + _AROUND), clip.frames)
            if b - a >= SHORTEST:
                draw = drawn_for(clip, name, peak)
                side = ("left", "right")[int(height[peak].argmax())]
                captions = said([text.format(side=side) for text in texts[where]], draw, 5)
                yield piece(clip, clip.joints[a:b], name, peak, captions)
