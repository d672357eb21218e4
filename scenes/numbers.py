"""Numbers as people give them, in Python or in a file, checked and turned into floats."""

from __future__ import annotations

from typing import Any

from scenes.errors import UserError, shown

MOST = 1e9
"""The largest number of a task, in any unit: its square, summed over all frames and joints of a minute, is far below
what single precision holds (3.4e38), and no place on Earth has a coordinate over 2.1e7 m in any common projection."""
LONGEST_WHOLE = 2**63 - 1
"""The largest whole number, as tensors and seeds hold them."""
NARROWEST = 1e-6
"""Metres: the smallest size of a shape; of smaller ones all corners are one, as those within 1e-8 m are merged."""
WIDEST = 10_000.0
"""Metres: the largest size of a shape, and the widest scene. Neighbours in single precision lie 1 mm apart there
(``numpy.spacing(numpy.float32(10000))``)."""


def is_number(value: Any) -> bool:
    """Whether a value is a finite number that somebody can have meant: no text, no boolean, at most `MOST`."""
    value = value.item() if hasattr(value, "dtype") and getattr(value, "ndim", 1) == 0 else value  # of NumPy or torch
    return isinstance(value, int | float) and not isinstance(value, bool) and -MOST <= value <= MOST


def vector(value: Any, what: str) -> tuple[float, float, float]:
    """Three finite numbers x, y, z; raises UserError for anything else."""
    try:
        x, y, z = value
    except (TypeError, ValueError) as error:
        raise UserError(f"{what} is {shown(value)}; give three numbers x, y, z in metres") from error
    if not (is_number(x) and is_number(y) and is_number(z)):
        raise UserError(f"{what} is {shown(value)}; give three finite numbers x, y, z in metres, at most {MOST:.0e}")
    return float(x), float(y), float(z)


def finite(value: Any, what: str) -> float:
    """A finite number; raises UserError for anything else."""
    if not is_number(value):
        raise UserError(f"{what} is {shown(value)}; give a finite number, at most {MOST:.0e}")
    return float(value)


def positive(value: Any, what: str, least: float = NARROWEST) -> float:
    """A size: a number above 0, from `least` to `WIDEST`; raises UserError for anything else."""
    if not least <= (number := finite(value, what)) <= WIDEST:
        raise UserError(f"{what} is {number:g}; give a positive number of metres, from {least:g} to {WIDEST:g}")
    return number
