"""Motions into files that others open: the format is told by the ending."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from scenectl.data.formats.people import UNITS
from scenectl.export.animation import Animation
from scenectl.export.names import named
from scenectl.export.settings import Settings
from scenes.errors import UserError, did_you_mean
from scenes.files import replaceable
from scenes.motion.frames import FAR
from scenes.motion.motion import Motion

FORMATS = {
    ".bvh": "bvh",
    ".glb": "glb",
    ".vrm": "glb",
    ".usd": "usd",
    ".usda": "usd",
    ".usdc": "usd",
    ".csv": "csv",
    ".npz": "npz",
}
"""By the ending of a file, the module of this package that writes it (`Format`)."""
_ALWAYS = {"fps", "root_motion", "names", "t0"}
_UPS = ("y", "z")
_DOUBLE = {".csv", ".npz"}
"""Endings of what is read by programs, in double precision."""


@runtime_checkable
class Format(Protocol):
    """A module that writes files.

    Attributes:
        SEVERAL: whether a file holds several animations; otherwise each comes into a file of its own.
        TAKES: names of the fields of `Settings`, beyond `fps`, `root_motion`, `names` and `t0`, that it heeds.
    """

    SEVERAL: bool
    TAKES: frozenset[str]

    def write(self, animations: Sequence[Animation], path: Path, settings: Settings) -> None:
        """Write a file, whole or not at all; raises UserError for what the format cannot hold."""


@dataclass(frozen=True)
class Exported:
    """What was written.

    Attributes:
        files: the files.
        animations: what they hold, in order.
        moved: by how much (m) joints moved at most, where a motion's pieces were not rigid; else 0.
        doubts: what tools may make of it, one sentence each.
    """

    files: tuple[Path, ...]
    animations: tuple[Animation, ...]
    moved: float
    doubts: tuple[str, ...] = ()


def export(motion: Motion, path: str | Path, settings: Settings | None = None, **stated: Any) -> Exported:
    """Write one motion ``[T, 22, 3]`` or several ``[S, T, 22, 3]``; see `Settings` for what may be stated by name.

    Several come into one file where the format holds them, and else into a file each, `NAME_0` and so on. Each file is
    written whole, or what was there before stays.

    Raises:
        UserError: an ending that no format has, what the format does not heed or cannot hold, or a path that cannot be
            written.
    """
    path = Path(path)
    if isinstance(stated.get("character"), str):
        stated["character"] = Path(stated["character"])
    settings = replace(settings or Settings(), **{"t0": motion.t0, **stated})
    form = format_of(path)
    check(settings, path)
    motions = [motion] if motion.joints.ndim == 3 else [motion[i] for i in range(len(motion.joints))]
    if not motions:
        raise UserError("there is no motion to export; make one")
    animations, moved = [], 0.0
    travels = settings.root_motion or settings.character is not None  # whose feet stand where it walks
    for place, one in enumerate(motions):
        animation, by = Animation.of(one, path.stem if len(motions) == 1 else f"{path.stem}_{place}")
        animation = animation if settings.fps is None else animation.resampled(settings.fps)
        animations.append(named(animation if travels else animation.in_place(), settings.names))
        moved = max(moved, by)
    doubts = () if path.suffix.lower() in _DOUBLE else _far(animations)
    if form.SEVERAL or len(animations) == 1:
        form.write(animations, path, settings)
        return Exported((path,), tuple(animations), moved, doubts)
    files = tuple(replaceable(path.with_stem(animation.name)) for animation in animations)
    for animation, file in zip(animations, files, strict=True):
        form.write([animation], file, settings)
    return Exported(files, tuple(animations), moved, doubts)


def _far(animations: Sequence[Animation]) -> tuple[str, ...]:
    """That people are farther away than tools can tell exactly, if they are."""
    away = max(float(np.abs(animation.roots).max()) for animation in animations)
    if away < FAR:
        return ()
    step = float(np.spacing(np.float32(away)))
    return (
        f"the motion lies {away:.0f} m from the origin, where tools that compute in single precision, as most do, "
        f"place things to {step:.1g} m only; move the scene near the origin, and the world in the tool",
    )


def format_of(path: Path) -> Format:
    """The format of a file by its ending; raises UserError for none, or one that is not written."""
    ending = path.suffix.lower()
    if ending in FORMATS:
        form: Format = import_module(f"scenectl.export.{FORMATS[ending]}")
        return form
    what = f"ends with '{path.suffix}'" if ending else "has no ending that tells its format"
    raise UserError(f"'{path}' {what}; {', '.join(FORMATS)} are written")


def check(settings: Settings, path: Path) -> None:
    """Raise UserError for values that no format knows, and for what the format of a file does not heed."""
    ending, takes = path.suffix.lower(), format_of(path).TAKES | _ALWAYS
    for field in fields(Settings):
        if field.name not in takes and getattr(settings, field.name) != field.default:
            raise UserError(f"{ending} files take no {field.name}; leave --{field.name} out")
    for what, value, known in (("unit", settings.unit, UNITS), ("up axis", settings.up, _UPS)):
        if value is not None and value not in known:
            raise UserError(f"unknown {what} '{value}'{did_you_mean(value, known)}")
    if settings.joints is not None and settings.character is None:
        raise UserError("joints are named for a character; state --character, too, or leave --joints out")
    if settings.character is not None and settings.names != Settings.names:
        raise UserError("a character's joints keep its own names; leave --names out")
    if ending == ".vrm" and settings.character is None:
        raise UserError("a .vrm file is a VRM character; give one with --character, or write a .glb file")


def export_beside(motion: Motion, folder: Path, endings: Sequence[str]) -> list[Exported]:
    """Write `motion.ENDING` into a folder for every ending: all motions where a format holds several, else the first.

    Args:
        motion: ``[S, T, 22, 3]``, the best first.
        folder: of a result.
        endings: as `endings_of` returns them.
    """
    files = [folder / f"motion{ending}" for ending in endings]
    return [export(motion if format_of(file).SEVERAL else motion[0], file) for file in files]


def endings_of(text: str) -> list[str]:
    """The endings in a list such as "glb,bvh"; raises UserError for one that is not written, or is a result's own."""
    endings = [f".{word.strip().removeprefix('.').lower()}" for word in text.split(",")]
    for ending in endings:
        if ending == ".npz":
            raise UserError("motion.npz is the result itself; other layouts of .npz are written by scenectl export")
        check(Settings(), Path(f"motion{ending}" if ending != "." else "motion"))
    return list(dict.fromkeys(endings))
