"""Pieces of recorded clips, and the sentences that say what they show."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import replace

from jaxtyping import Float
from torch import Tensor

from scenectl.data.corpus import Act, Clip
from scenectl.data.features import canonicalise

SHORTEST, WANTED = 24, 36
"""Frames of a piece at least, and those that training and evaluation look at at least."""
_SUBJECTS = ("a person", "a person", "a person", "someone", "the person", "a man", "a woman", "a human")


def piece(
    clip: Clip, joints: Float[Tensor, "T 22 3"], name: str, at: int, captions: Sequence[str], acts: Sequence[Act] = ()
) -> Clip:
    """A clip of its own, named after the clip that it was found in, what it shows and where."""
    return replace(
        clip,
        id=f"{clip.id}~{name.replace(' ', '-')}{at}",
        joints=canonicalise(joints),
        captions=tuple(dict.fromkeys(captions)),
        label=f"{clip.label}, {name}",
        acts=tuple(acts),
    )


def drawn_for(clip: Clip, name: str, at: int) -> random.Random:
    """Chance that is the same whenever the same piece is found."""
    return random.Random(f"{clip.source} {clip.id} {name} {at}")


def widened(begin: int, end: int, frames: int, wanted: int = WANTED) -> tuple[int, int]:
    """The stretch with as many of the frames around it as make it `wanted` long, where the clip has them."""
    missing = max(0, wanted - (end - begin))
    begin = max(0, begin - (missing + 1) // 2)
    end = min(frames, max(end, begin + wanted))
    return max(0, min(begin, end - wanted)), end


def said(predicates: Sequence[str], draw: random.Random, most: int = 4) -> tuple[str, ...]:
    """Sentences: some of the predicates ("sits down"), each of a person."""
    some = draw.sample(list(predicates), min(most, len(predicates)))
    return tuple(f"{draw.choice(_SUBJECTS)} {text}." for text in some)
