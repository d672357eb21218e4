"""What people stay within: quantiles of recorded motion and their source, as `scenectl bench limits` measured them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

FILE = Path(__file__).with_name("limits.json")


@dataclass(frozen=True)
class Limits:
    """Figures that were measured on recordings.

    Attributes:
        about: the command that measured them, of how many clips, from where and under what licence.
        values: the limit of each check, by its name and in its unit.
        tempo: bias, then weight of each feature of the check of that name.
    """

    about: Mapping[str, Any] = field(default_factory=dict)
    values: Mapping[str, float] = field(default_factory=dict)
    tempo: tuple[float, ...] = ()

    @classmethod
    def read(cls, file: Path = FILE) -> Limits:
        """The limits of a file that `bench limits` wrote; none where there is no such file."""
        if not file.is_file():
            return cls()
        stored = json.loads(file.read_text(encoding="utf-8"))
        return cls(stored["about"], {k: v["limit"] for k, v in stored["checks"].items()}, tuple(stored["tempo"]))


LIMITS = Limits.read()
