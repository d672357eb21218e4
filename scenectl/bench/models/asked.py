"""Files of sentences that a generator shall follow: several acts in one sentence, or sentences with their times."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError, model_validator

from scenectl.evaluation.kinds import WINDOWS
from scenectl.generators.prompts import Prompt, Prompts
from scenes.errors import UserError, did_you_mean
from scenes.files import read_toml
from scenes.tables import Table
from scenes.validation import sentence

SENTENCES = Path(__file__).with_name("sentences.toml")
"""The file that ships: 50 sentences of two and three acts, and timelines of four."""

_Text = Annotated[str, Field(min_length=1, pattern=r"\S")]
_Seconds = Annotated[float, Field(gt=0, le=120)]


class Sentence(Table):
    """One sentence that says several acts in their order.

    Attributes:
        text: what a generator is told.
        seconds: length of the motion.
        acts: what must be recognised, in order.
    """

    text: _Text
    seconds: _Seconds
    acts: Annotated[tuple[str, ...], Field(min_length=1)]


class Part(Table):
    """A sentence with its time (s) and the act that must be recognised in it."""

    text: _Text
    begin: Annotated[float, Field(ge=0)]
    end: _Seconds
    act: str


class Timeline(Table):
    """Sentences one after another.

    Attributes:
        seconds: length of the motion.
        part: of it, in order.
    """

    seconds: _Seconds
    part: Annotated[tuple[Part, ...], Field(min_length=1)]

    @property
    def prompts(self) -> Prompts:
        """What a generator is told."""
        return Prompts(tuple(Prompt(part.text, part.begin, part.end) for part in self.part))

    @property
    def seams(self) -> list[float]:
        """Where (s) one sentence ends and another begins."""
        ends = {time for part in self.part for time in (part.begin, part.end)}
        return sorted(ends - {0.0, self.seconds})

    @model_validator(mode="after")
    def _in_order(self) -> Timeline:
        at = 0.0
        for part in self.part:
            if not at <= part.begin <= part.end - WINDOWS[0]:
                raise ValueError(
                    f"part '{part.text}' is from {part.begin:g} to {part.end:g} s; parts follow one another and last "
                    f"{WINDOWS[0]:g} s at least, which is what the classifier looks at"
                )
            at = part.end
        if at > self.seconds:
            raise ValueError(f"part '{self.part[-1].text}' ends at {at:g} s, after the timeline's {self.seconds:g} s")
        return self


class Asked(Table):
    """All that a file asks for.

    Attributes:
        kinds: of each act, by its name: the kinds of the classifier that show it.
        sentence, timeline: what is asked.
    """

    kinds: dict[str, Annotated[tuple[str, ...], Field(min_length=1)]]
    sentence: tuple[Sentence, ...] = ()
    timeline: tuple[Timeline, ...] = ()

    @property
    def acts(self) -> list[tuple[str, ...]]:
        """Of each sentence, then of each timeline."""
        return [*(each.acts for each in self.sentence), *(tuple(p.act for p in line.part) for line in self.timeline)]

    @model_validator(mode="after")
    def _named(self) -> Asked:
        if not self.sentence and not self.timeline:
            raise ValueError("there is no [[sentence]] and no [[timeline]]; write one")
        for act in (act for acts in self.acts for act in acts):
            if act not in self.kinds:
                raise ValueError(f"act '{act}' is not in [kinds]{did_you_mean(act, self.kinds)}")
        return self

    def check(self, known: tuple[str, ...]) -> None:
        """Raise UserError for an act whose kinds a classifier has never heard of."""
        for act in {act for acts in self.acts for act in acts}:
            if not set(self.kinds[act]) & set(known):
                raise UserError(
                    f"the classifier knows no kind of act '{act}' ({', '.join(self.kinds[act])}); it knows "
                    f"{', '.join(known)}: name some of these in [kinds], or train it on clips that show the act"
                )


def load_asked(path: str | Path = SENTENCES) -> Asked:
    """Read a file of sentences; raises UserError naming the file for anything that is wrong in it."""
    table = read_toml(path, "file of sentences")
    try:
        return Asked(**table)
    except ValidationError as error:
        raise UserError(f"file of sentences '{path}': {sentence(error, table, Asked)}") from error
