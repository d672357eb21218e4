"""A humanoid robot from its own file, and which of its bodies move as which of our joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, eq=False)
class Robot:
    """A humanoid robot.

    Attributes:
        name, source: the file's stem and the file.
        model: MuJoCo's, with a free joint at the root.
        joints: {one of our 22 joints: the body of the model that moves as it does}.
        doubts: what whoever gave the file should hear about how it was read, one sentence each.
    """

    name: str
    source: str
    model: Any
    joints: dict[str, str]
    doubts: tuple[str, ...] = ()
