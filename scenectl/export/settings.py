"""What whoever exports asks of a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from scenes.world.scene import Scene


@dataclass(frozen=True)
class Settings:
    """How files are written; None is what is usual in a format.

    Attributes:
        fps: frames a second; None keeps the motion's.
        root_motion: whether the root walks, or stays in place.
        names: a preset of `scenectl.export.names`.
        up: the axis that is up, "y" or "z".
        unit: of lengths, a key of `scenectl.data.formats.people.UNITS`.
        scene: the room, to be written with the motion.
        t0: time (s) of the motion's first frame on the clock of what moves in the scene.
        layout: of an NPZ file, one of `scenectl.export.npz.LAYOUTS`.
        character: a skinned character to play the motion instead of our mannequin.
        joints: {our joint: the character's}, where its names say too little.
    """

    fps: float | int | None = None
    root_motion: bool = True
    names: str = "humanml"
    up: str | None = None
    unit: str | None = None
    scene: Scene | None = None
    t0: float = 0.0
    layout: str | None = None
    character: Path | None = None
    joints: dict[str, str] | None = None
