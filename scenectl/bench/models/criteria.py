"""Criteria: what is wanted of a figure, beside what was measured."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

HEADS = ("criterion", "wanted", "got", "met")


def within(what: str, low: float, high: float, got: float | None) -> dict[str, Any]:
    """A criterion that wants a figure from `low` to `high`; one that was not measured is not met."""
    wanted = (
        f"at most {high:g}" if low == -math.inf else f"at least {low:g}" if high == math.inf else f"{low:g} to {high:g}"
    )
    return {"criterion": what, "wanted": wanted, "got": got, "met": got is not None and low <= got <= high}


def at_least(what: str, low: float, got: float | None) -> dict[str, Any]:
    """A criterion that wants a figure to be `low` or more."""
    return within(what, low, math.inf, got)


def at_most(what: str, high: float, got: float | None) -> dict[str, Any]:
    """A criterion that wants a figure to be `high` or less."""
    return within(what, -math.inf, high, got)


def lines(criteria: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Rows of a table: criterion, wanted, got, met."""
    return [
        [
            row["criterion"], row["wanted"], "not measured" if row["got"] is None else f"{row['got']:.3g}",
            "yes" if row["met"] else "no",
        ]
        for row in criteria
    ]  # fmt: skip
