"""What a check is: a figure of a motion, what people stay within, and the sentence that tells both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from scenectl.measures.believability.evidence import Evidence


@dataclass(frozen=True)
class Found:
    """The worst that a check found in a motion, whether people do it or not.

    Attributes:
        value: in the check's unit.
        sentence: where, when and by how much, without a full stop.
        at_s: when, s; None for the whole motion.
        part: of the body, or None.
    """

    value: float
    sentence: str
    at_s: float | None = None
    part: str | None = None


@dataclass(frozen=True)
class Check:
    """One thing that no person does.

    Attributes:
        name: as findings and figures call it.
        unit: of the value, with `name` the key among figures.
        look: the worst of a motion; None where it is too short, or this is not its concern.
        limit: what people stay within where it is stated; None where it is measured (`limits`).
        source: of a stated limit.
        share: of recorded motions that a measured limit lets pass.
        explains: findings of a check that ranks higher explain others, and come first: a body with a false arm is
            also off balance.
        plainly: times its limit from which on it explains others.
        least: people stay above the limit rather than below.
        grows: the limit is an adult's, and others' in proportion to their legs: bodies of all sizes take as many steps
            a second here (`scenectl.control.figure`).
    """

    name: str
    unit: str
    look: Callable[[Evidence], Found | None]
    limit: float | None = None
    source: str = ""
    share: float = 0.997
    explains: int = 0
    plainly: float = 1.0
    least: bool = False
    grows: bool = False

    @property
    def key(self) -> str:
        """Name with unit, as figures are called: "penetration_m"."""
        return f"{self.name}_{self.unit.replace('/', '_per_').replace('^', '')}"
