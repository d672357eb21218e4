"""Text features of captions, for networks that learn from motions with their sentences."""

from __future__ import annotations

import hashlib
import json
import random
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from scenectl.data.clips import ClipSet, Drawn, Told
from scenectl.networks.text import Said, TextEncoder, TimedText
from scenes.files import atomic_write

SHOWN, MOSTLY = 16, 2 / 3
"""Frames of an act that a window shows at least, or share of a short act, for its caption to be about the window: what
is told of somebody who sits down shall not be the last moments of it and then seconds on a seat."""

_BATCH = 64
"""Texts that are encoded at once."""


class _Encoded(NamedTuple):
    """Features of texts, in half precision.

    Attributes:
        rows: row of each text.
        sentence: a row a text.
        words: of all texts, one after the other; padded to the longest, those of a large data set would fill memory.
        starts: first word of each text, with their number at the end.
    """

    rows: dict[str, int]
    sentence: Float[Tensor, "T D"]
    words: Float[Tensor, "N D"]
    starts: Int[Tensor, " T1"]

    @classmethod
    def of(cls, texts: Sequence[str], encoder: TextEncoder) -> _Encoded:
        """Encode texts, those of one length together."""
        texts = sorted(texts, key=len)
        parts = [encoder.encode(texts[i : i + _BATCH]) for i in range(0, len(texts), _BATCH)]
        words = [row[mask].half().cpu() for p in parts for row, mask in zip(p.words, p.mask, strict=True)]
        starts = torch.tensor([0, *map(len, words)]).cumsum(0)
        rows = {text: i for i, text in enumerate(texts)}
        return cls(rows, torch.cat([p.sentence.half().cpu() for p in parts]), torch.cat(words), starts)

    @classmethod
    def load(cls, path: Path) -> _Encoded | None:
        """What was stored; None where there is nothing, or nothing whole."""
        try:
            with safe_open(path, framework="pt") as file:
                rows = {text: i for i, text in enumerate(json.loads(file.metadata()["texts"]))}
                return cls(rows, *(file.get_tensor(name).clone() for name in cls._fields[1:]))
        except (OSError, SafetensorError, KeyError, TypeError, ValueError):
            return None

    def store(self, path: Path) -> None:
        arrays = {name: getattr(self, name) for name in self._fields[1:]}
        with atomic_write(path) as file:
            file.write(save(arrays, metadata={"texts": json.dumps(list(self.rows))}))

    def and_more(self, other: _Encoded) -> _Encoded:
        """Both together; `other` holds other texts."""
        return _Encoded(
            {text: i for i, text in enumerate([*self.rows, *other.rows])},
            torch.cat([self.sentence, other.sentence]),
            torch.cat([self.words, other.words]),
            torch.cat([self.starts, self.starts[-1] + other.starts[1:]]),
        )

    def said(self, text: str, begin: float = 0.0, end: float = torch.inf) -> Said:
        """One text, about a stretch of time."""
        row = self.rows[text]
        words = self.words[int(self.starts[row]) : int(self.starts[row + 1])]
        return Said(self.sentence[row].float(), words.float(), begin, end)


def _encoded(texts: set[str], encoder: TextEncoder, cache: Path | None) -> _Encoded:
    """Features of texts and of those that other runs have left in `cache`, where what is new is kept, too."""
    name = hashlib.sha256(encoder.name.encode()).hexdigest()[:16]
    path = cache and cache / f"texts-{name}.safetensors"
    known = _Encoded.load(path) if path else None
    if known is not None and not _agrees(known, encoder):
        known = None
    missing = sorted(texts if known is None else texts - known.rows.keys())
    if missing:
        fresh = _Encoded.of(missing, encoder)
        known = fresh if known is None else known.and_more(fresh)
        if path:
            known.store(path)
    assert known is not None
    return known


def _agrees(known: _Encoded, encoder: TextEncoder) -> bool:
    """Whether an encoder gives what is known of a text: of two in one folder, only the name is the same."""
    text = next(iter(known.rows))
    one, other = known.said(text).sentence, encoder.encode([text]).sentence[0].cpu().float()
    return one.shape == other.shape and torch.allclose(one, other, atol=0.01)


class Captions:
    """Text features of every caption, encoded once.

    A window of a clip that shows several things one after another is told what it shows of them, in one sentence or
    act by act, as often one as the other.
    """

    def __init__(self, data: ClipSet, encoder: TextEncoder, cache: Path | None = None) -> None:
        """Encode all sentences, or read from the folder `cache` what was encoded before."""
        self._told = data.told
        texts = {text for stretches in data.told for told in stretches for text in told.captions}
        self._encoded = _encoded(texts, encoder, cache)

    def of_clips(self, clips: Int[Tensor, " B"], generator: torch.Generator) -> TimedText:
        """A random caption of each clip, on the CPU (`Placement.text` moves it)."""
        draw = _drawer(generator)
        said = (self._encoded.said(draw.choice(self._told[clip][0].captions)) for clip in clips.tolist())
        return TimedText.of([[one] for one in said])

    def of_windows(self, windows: Drawn, per_token: int, generator: torch.Generator) -> TimedText:
        """What each window shows, on the CPU; times are in tokens of so many frames."""
        draw, frames = _drawer(generator), windows.features.shape[1]
        places = zip(windows.clips.tolist(), windows.offsets.tolist(), strict=True)
        return TimedText.of(
            [
                [
                    self._encoded.said(draw.choice(told.captions), told.begin / per_token, told.end / per_token)
                    for told in sentences(self._told[clip], offset, frames, draw)
                ]
                for clip, offset in places
            ]
        )


def sentences(told: Sequence[Told], offset: int, frames: int, draw: random.Random) -> list[Told]:
    """What is said of a window of a clip, in frames of the window: one stretch, or one after another, without gaps."""
    acts = [one for one in told[1:] if one.acts == 1] if told[0].acts > 1 else told[:1]
    shown = [one for one in acts if _overlap(one, offset, frames) >= enough(one.end - one.begin)]
    shown = shown or [max(acts, key=lambda one: _overlap(one, offset, frames))]
    if len(shown) > 1 and draw.random() < 0.5:
        edges = [0, *(one.begin - offset for one in shown[1:]), frames]
        return [one._replace(begin=a, end=b) for one, a, b in zip(shown, edges[:-1], edges[1:], strict=True)]
    joint = next(one for one in told if (one.begin, one.acts) == (shown[0].begin, len(shown)))
    return [joint._replace(begin=0, end=frames)]


def enough(frames: int) -> float:
    """How many of an act's frames a window shows at least for its caption to be about the window."""
    return min(float(SHOWN), MOSTLY * frames)


def _overlap(told: Told, offset: int, frames: int) -> int:
    return min(told.end, offset + frames) - max(told.begin, offset)


def _drawer(generator: torch.Generator) -> random.Random:
    """Random choices that a torch generator decides."""
    return random.Random(int(torch.randint(2**62, (), generator=generator)))
