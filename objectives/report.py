"""What a report says about one term and one sample."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any


@dataclass(frozen=True)
class TermReport:
    """How well one motion meets one term.

    Attributes:
        name: the term's name; goal: the goal it uses; unit: of worst, mean and tolerance.
        worst: largest length of any active entry. mean: over all active (frame, entry) pairs. Both nan where the term
            was never active.
        tolerance, met: met is worst <= tolerance; what is not a number or never active is never met.
        when: time of the worst, seconds on the task's clock; None where nothing was active.
        where: the joint or point of the worst, and its `position` in the world, metres.
        active_frames: frames at which the term applied.
        cost: the term's share of the objective's cost. weight: the term's.
        series: largest length of any active entry in each frame; None where none was.
    """

    name: str
    goal: str
    unit: str
    worst: float
    mean: float
    tolerance: float
    met: bool
    cost: float
    weight: float
    when: float | None = None
    where: str | None = None
    position: tuple[float, float, float] | None = None
    active_frames: int = 0
    series: tuple[float | None, ...] = field(default=(), repr=False)

    def as_dict(self) -> dict[str, Any]:
        """All but the series, for JSON, which knows no nan or infinity: those become None."""
        return {key: _finite(value) for key, value in asdict(replace(self, series=())).items() if key != "series"}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> TermReport:
        """What `as_dict` made the values of; a number that JSON could not hold is infinite, a coordinate nan."""
        measured = {key: math.inf if values[key] is None else float(values[key]) for key in ("worst", "mean", "cost")}
        stated = {key: float(values[key]) for key in ("tolerance", "weight")}
        place, when = values.get("position"), values.get("when")
        position = None if place is None else tuple(math.nan if c is None else float(c) for c in place)
        return cls(
            **{**values, **measured, **stated, "position": position, "when": None if when is None else float(when)}
        )

    def sentence(self) -> str:
        """One line for a person: name, worst, when, where, tolerance, met or not."""
        if self.when is None:
            return f"{self.name}: not met (never active)"
        place = f" at {self.where}" if self.where else ""
        met = "met" if self.met else "not met"
        figures = f"worst {self.worst:.3g} {self.unit}{place} at {self.when:.2f} s, mean {self.mean:.3g} {self.unit}"
        return f"{self.name}: {met} ({figures}, tolerance {self.tolerance:g} {self.unit})"


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, tuple):
        return [_finite(v) for v in value]
    return value
