"""The one exception a user may meet: a sentence that says what is wrong, where, and what to do."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches


class UserError(ValueError):
    """Bad input. Its text is one sentence for a person; the command line prints it and exits with 2."""


@contextmanager
def in_doubt(doubts: Callable[[], Iterable[str]]) -> Iterator[None]:
    """UserErrors inside say what is in doubt when they are raised, since that may be their cause."""
    try:
        yield
    except UserError as error:
        if known := "; ".join(doubts()):
            raise UserError(f"{error}; in doubt: {known}") from error
        raise


def shown(value: object) -> str:
    """A value as Python writes it, cut short."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # Python writes no whole number of over 4,300 digits
        return f"a {type(value).__name__} too long to be shown"
    return clipped(text)


def clipped(text: str, most: int = 80) -> str:
    """A text of so many letters at most."""
    return text if len(text) <= most else text[: most - 3] + "..."


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` for the nearest known word, or the list of known words."""
    known = sorted(known)
    near = get_close_matches(word, known, n=1, cutoff=0.5)
    if near:
        return f"; did you mean '{near[0]}'?"
    return f"; known are {', '.join(known)}" if known else ""
