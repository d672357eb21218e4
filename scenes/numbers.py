"""Numbers as people give them, in Python or in a file, checked and turned into floats."""

from __future__ import annotations

import math
from typing import Any

from scenes.errors import UserError


def vector(value: Any, what: str) -> tuple[float, float, float]:
    """Three finite numbers x, y, z; raises UserError for anything else."""
    try:
        x, y, z = (float(number) for number in value)
    except (TypeError, ValueError) as error:
        raise UserError(f"{what} is {value!r}; give three numbers x, y, z in metres") from error
    if not all(math.isfinite(number) for number in (x, y, z)):
        raise UserError(f"{what} is {value!r}; give three finite numbers x, y, z in metres")
    return x, y, z


def finite(value: Any, what: str) -> float:
    """A finite number; raises UserError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise UserError(f"{what} is {value!r}; give a finite number")
    return float(value)


def positive(value: Any, what: str) -> float:
    """A finite number above 0; raises UserError for anything else."""
    if (number := finite(value, what)) <= 0:
        raise UserError(f"{what} is {value}; give a positive number of metres")
    return number
