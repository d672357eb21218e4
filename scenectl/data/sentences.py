"""Sentences: several of them about one person, said in one."""

from __future__ import annotations

import random
import re
from collections.abc import Sequence

SUBJECT = re.compile(r"^(a person|someone|the person|a man|a woman|a human|he|she|they) (?=\w)")
"""What the sentences of the collection begin with."""
JOINTS = (", then ", " and then ", ", and then ", " and ", ", after that ")
"""Between one thing and the next."""


def in_one(captions: Sequence[Sequence[str]], most: int = 6) -> tuple[str, ...]:
    """Sentences that say several things in their order: "a person walks forward, then sits down".

    Args:
        captions: of each thing, sentences that say it.
        most: how many are made, each of other sentences and joined in another way; equal ones count once.
    """
    draw = random.Random("|".join(text for texts in captions for text in texts))
    return tuple(dict.fromkeys(_joined([draw.choice(list(texts)) for texts in captions], draw) for _ in range(most)))


def _joined(texts: Sequence[str], draw: random.Random) -> str:
    first, *rest = (text.strip().rstrip(".") for text in texts)
    said = first
    for i, text in enumerate(rest):
        plain = "" if i + 1 < len(rest) and draw.random() < 0.5 else draw.choice(JOINTS)
        said += (plain or ", ") + SUBJECT.sub("", text)
    return f"{said}."
