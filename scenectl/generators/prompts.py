"""Prompts: what a motion shall be, in sentences, each with the time that it is about."""

from __future__ import annotations

from dataclasses import dataclass

from scenes.errors import UserError


@dataclass(frozen=True)
class Prompt:
    """One sentence.

    Attributes:
        text: what the person does.
        begin, end: seconds of the motion that it is about; to its end where `end` is None.
    """

    text: str
    begin: float = 0.0
    end: float | None = None


@dataclass(frozen=True)
class Prompts:
    """The sentences of one motion, in order of their beginning."""

    sentences: tuple[Prompt, ...]

    def __post_init__(self) -> None:
        if not self.sentences or not all(prompt.text.strip() for prompt in self.sentences):
            raise UserError("the prompt is empty; describe the motion in a sentence, such as 'a person walks'")
        for prompt in self.sentences:
            if not 0 <= prompt.begin < (float("inf") if prompt.end is None else prompt.end):
                raise UserError(
                    f"prompt '{prompt.text}' is from {prompt.begin:g} to {prompt.end} s; end it after it begins"
                )

    @classmethod
    def of(cls, given: Prompts | str) -> Prompts:
        """The prompts themselves, or one sentence for the whole motion."""
        return given if isinstance(given, Prompts) else cls((Prompt(given),))

    def single(self, generator: str) -> str:
        """The one sentence that is about the whole motion, for a generator that takes no more.

        Raises:
            UserError: there are several, or it is about a part.
        """
        first = self.sentences[0]
        if len(self.sentences) > 1 or first.begin > 0 or first.end is not None:
            raise UserError(
                f"generator '{generator}' takes one sentence for the whole motion, and was given "
                f"{len(self.sentences)} with times; join them in one, or generate the parts one after the other"
            )
        return first.text
