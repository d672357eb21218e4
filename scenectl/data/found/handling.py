"""Putting down and picking up: where hands go low or high, in clips whose labels or captions say what they do there."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
from scipy.signal import find_peaks

from scenectl.data.corpus import Clip
from scenectl.data.features import FPS
from scenectl.data.found.pieces import SHORTEST, drawn_for, piece, said, widened
from scenectl.data.found.traits import HEAD, PELVIS, TOES, WRISTS, Traits

_FLOOR, _HIGH = 0.55, 0.1
"""Height (m) of a wrist whose hand is at the floor, and how far below a standing head one is that is up high."""
_LYING, _OFF_FLOOR, _PASSING = 0.25, 0.15, 0.8
"""Who has the pelvis lower (m) lies, both feet higher (m) jumps, who is faster (m/s) passes by."""
_AWAY = 0.1
"""How much farther off (m) hands are where a piece begins and ends: they go there and come back."""
_AROUND = 50
"""Frames before and after the hand is there that a piece may take."""

_PUTS = re.compile(
    r"deposit|\bput(?:s|ting)? .*\b(?:down|floor|ground)\b|\bplac(?:e|es|ing) .*\b(?:floor|ground)\b", re.I
)
_PICKS = re.compile(r"\bpick(?:s|ing)?\b.*\bup\b|\bscoop", re.I)
_GRABS = re.compile(r"\bgrab|\btak(?:es|ing) .*\b(?:down|shelf)\b", re.I)
_WAYS = (
    ("put down", "floor", _PUTS, (
        "puts something down on the floor with the {side} hand", "bends down and puts something on the floor",
        "sets something down on the ground with the {side} hand", "places an object on the floor",
        "lowers something to the floor and puts it down", "puts something down", "lays something on the ground",
    )),
    ("pick up", "floor", _PICKS, (
        "picks something up from the floor with the {side} hand", "bends down and picks something up",
        "picks up an object from the ground", "picks something up", "reaches down to the floor and picks something up",
    )),
    ("pick up", "high", _GRABS, (
        "takes something from up high with the {side} hand", "reaches up and grabs something with the {side} hand",
        "grabs something up high", "takes something down from a high shelf", "reaches high up to take something",
        "stretches the {side} arm up and takes something",
    )),
)  # fmt: skip


def handlings(clip: Clip) -> Iterator[Clip]:
    """Every time that a hand is at the floor or up high, with as much around it as is not another time."""
    text = " ".join((clip.label, *clip.captions))
    ways = [way for way in _WAYS if way[2].search(text)]
    if {name for name, *_ in ways} != {"put down"} and {name for name, *_ in ways} != {"pick up"}:
        return  # neither, or the motion does not say which is which
    wrists, height = (clip.joints[:, joints, 1].double().numpy() for joints in (WRISTS, PELVIS))
    standing = float(clip.joints[:, HEAD, 1].quantile(0.9))
    sound = (height > _LYING) & (clip.joints[:, TOES, 1].numpy().min(1) < _OFF_FLOOR)
    sound &= Traits.of(clip.joints).speed < _PASSING
    for name, where, _, texts in ways:
        there = _FLOOR - wrists if where == "floor" else wrists - standing + _HIGH
        peaks = (
            find_peaks(np.pad(there.max(1), 1, constant_values=-9.0), height=0.0, distance=FPS, prominence=0.2)[0] - 1
        )
        edges = [0, *((peaks[:-1] + peaks[1:]) // 2).tolist(), clip.frames]
        for i, peak in enumerate(peaks.tolist()):
            a, b = widened(max(edges[i], peak - _AROUND), min(edges[i + 1], peak + _AROUND), clip.frames)
            if not sound[peak] or b - a < SHORTEST or max(there[a].max(), there[b - 1].max()) > -_AWAY:
                continue
            side = ("left", "right")[int(there[peak].argmax())]
            fitting = [words for words in texts if "{side}" not in words or there[peak].min() < 0]  # one hand of two
            captions = said([words.format(side=side) for words in fitting], drawn_for(clip, name, peak), 5)
            yield piece(clip, clip.joints[a:b], name, peak, captions)
