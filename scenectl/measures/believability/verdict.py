"""The verdict on a body's motion: what no person does, where, when and by how much."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Finding:
    """One thing about a motion that no person does.

    Attributes:
        check: name of the check that found it, such as "penetration".
        value, limit: what was measured and what people stay within, in `unit`.
        unit: "m", "m/s", "s", ...
        at_s: when it is worst, s; None where that is the whole motion.
        part: of the body, or None.
        sentence: where, when and by how much, without a full stop.
    """

    check: str
    value: float
    limit: float
    unit: str
    sentence: str
    at_s: float | None = None
    part: str | None = None

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for report.json."""
        return {
            "check": self.check,
            "value": self.value,
            "limit": self.limit,
            "unit": self.unit,
            "at_s": self.at_s,
            "part": self.part,
            "sentence": self.sentence,
        }


@dataclass(frozen=True)
class Verdict:
    """What all checks say about one motion.

    Attributes:
        findings: what is not believable, the worst first.
        figures: what each check measured, by name with its unit ("penetration_m"), found fault with or not.
        exempted: sentences on what goals exempted and how deep it went; told, not counted.
    """

    findings: tuple[Finding, ...] = ()
    figures: dict[str, float | None] = field(default_factory=dict)
    exempted: tuple[str, ...] = ()

    @property
    def believable(self) -> bool:
        """No check found fault."""
        return not self.findings

    @property
    def sentence(self) -> str:
        """The worst finding: where, when, by how much."""
        return "believable" if self.believable else self.findings[0].sentence

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for report.json."""
        return {
            "sentence": self.sentence,
            "findings": [finding.as_dict() for finding in self.findings],
            "figures": dict(self.figures),
            "exempted": list(self.exempted),
        }
