"""All checks: a file for each thing that they look at, and one line here."""

from __future__ import annotations

from scenectl.measures.believability.checks import balance, contact, limbs, pace, sliding, stillness, support, tempo
from scenectl.measures.believability.checks.check import Check

CHECKS: tuple[Check, ...] = (
    *limbs.CHECKS, *contact.CHECKS, *support.CHECKS, *sliding.CHECKS, *balance.CHECKS, *pace.CHECKS, *tempo.CHECKS,
    *stillness.CHECKS,
)  # fmt: skip
