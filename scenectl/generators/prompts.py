"""Prompts: what a motion shall be, in sentences, each with the time that it is about."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

from scenectl.data.sentences import apart
from scenes.errors import UserError, clipped

_SLACK = 1e-6
"""Seconds that are rounding: one sentence's end and the next one's beginning may be the same number, computed twice."""


@dataclass(frozen=True)
class Prompt:
    """One sentence.

    Attributes:
        text: what the person does.
        begin, end: seconds of the motion that it is about; until the next begins, or to the end, where `end` is None.
    """

    text: str
    begin: float = 0.0
    end: float | None = None

    def __str__(self) -> str:
        return f"{self.begin:g} s{'' if self.end is None else f' to {self.end:g} s'}: {self.text}"


@dataclass(frozen=True)
class Prompts:
    """The sentences of one motion, in order of their beginning; no two are about the same time."""

    sentences: tuple[Prompt, ...]

    def __post_init__(self) -> None:
        if not self.sentences or not all(prompt.text.strip() for prompt in self.sentences):
            raise UserError("the prompt is empty; describe the motion in a sentence, such as 'a person walks'")
        for prompt in self.sentences:
            if not 0 <= prompt.begin < (math.inf if prompt.end is None else prompt.end):
                raise UserError(
                    f"prompt '{clipped(prompt.text)}' is from {prompt.begin:g} to {prompt.end} s; begin it at 0 or "
                    "later, and end it after it begins"
                )
        for one, other in pairwise(self.sentences):
            if other.begin <= one.begin or (one.end is not None and other.begin < one.end - _SLACK):
                until = f"{one.begin:g} s on" if one.end is None else f"{one.begin:g} to {one.end:g} s"
                raise UserError(
                    f"prompt '{clipped(other.text)}' begins at {other.begin:g} s, and '{clipped(one.text)}' is from "
                    f"{until}; write sentences in order, each for a time of its own"
                )

    @classmethod
    def of(cls, given: Prompts | str) -> Prompts:
        """The prompts themselves, or one sentence for the whole motion."""
        return given if isinstance(given, Prompts) else cls((Prompt(given),))

    def __str__(self) -> str:
        """The one sentence that is about the whole motion, or all of them with their times."""
        return self.sentences[0].text if self._plain else "; ".join(map(str, self.sentences))

    @property
    def _plain(self) -> bool:
        first = self.sentences[0]
        return len(self.sentences) == 1 and first.begin == 0 and first.end is None

    def check(self, seconds: float) -> None:
        """Raises UserError for a sentence that begins after a motion of so many seconds ends."""
        last = self.sentences[-1]
        if last.begin >= seconds:
            raise UserError(
                f"prompt '{clipped(last.text)}' begins at {last.begin:g} s, and the motion lasts {seconds:g} s; begin "
                "it earlier, or make the motion longer"
            )

    def doubts(self, seconds: float) -> tuple[str, ...]:
        """On times of a motion of so many seconds that no sentence is about, and on sentences that are cut short."""
        spans = [(p.begin, self._end(i, seconds)) for i, p in enumerate(self.sentences)]
        gaps = [*pairwise([0.0, *(time for span in spans for time in span), seconds])][::2]
        told = [
            f"no prompt is about {a:g} to {b:g} s, so the nearest one counts there" for a, b in gaps if b - a > _SLACK
        ]
        if (end := spans[-1][1]) > seconds + _SLACK:
            text = clipped(self.sentences[-1].text)
            told.append(f"prompt '{text}' ends at {end:g} s, after the motion, which lasts {seconds:g} s")
        return tuple(told)

    def spans(self) -> tuple[Prompt, ...]:
        """The same sentences so that one is about any time: gaps are halved between neighbours, and none ends last."""
        times = [(p.begin, self._end(i, math.inf)) for i, p in enumerate(self.sentences)]
        edges = [0.0, *((a[1] + b[0]) / 2 for a, b in pairwise(times)), None]
        return tuple(Prompt(p.text, a or 0.0, b) for p, a, b in zip(self.sentences, edges, edges[1:], strict=False))

    def act_by_act(self, seconds: float) -> Prompts:
        """A sentence of its own for each thing that one sentence says after another, over equal shares of its time.

        A generator follows a sentence and its time better than the order of words in one (`scenectl bench sentences`).
        """
        told = list[Prompt]()
        for i, prompt in enumerate(self.sentences):
            parts, end = apart(prompt.text), self._end(i, seconds)
            begins = [prompt.begin + (end - prompt.begin) * k / len(parts) for k in range(len(parts))]
            told += [Prompt(*part) for part in zip(parts, begins, [*begins[1:], prompt.end], strict=True)]
        return Prompts(tuple(told))

    def within(self, begin: float, end: float) -> Prompts:
        """What is said of a part of the motion, in seconds of that part."""
        spans = [p for p in self.spans() if p.begin < end - _SLACK and (p.end is None or p.end > begin + _SLACK)]
        return Prompts(tuple(Prompt(p.text, max(p.begin - begin, 0.0)) for p in spans))

    def _end(self, i: int, seconds: float) -> float:
        """Until when a sentence is: as stated, or to the next one, or to the end."""
        end, rest = self.sentences[i].end, self.sentences[i + 1 :]
        return end if end is not None else rest[0].begin if rest else seconds

    def single(self, generator: str) -> str:
        """The one sentence that is about the whole motion, for a generator that takes no more.

        Raises:
            UserError: there are several, or it is about a part.
        """
        if not self._plain:
            raise UserError(
                f"generator '{generator}' takes one sentence for the whole motion, and was given "
                f"{len(self.sentences)} with times; join them in one, or generate the parts one after the other"
            )
        return self.sentences[0].text
