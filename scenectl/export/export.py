"""Motions into files that others open: the format is told by the ending."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from scenectl.export.animation import Animation
from scenectl.export.names import named
from scenectl.export.settings import Settings
from scenes.errors import UserError
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


class Format(Protocol):
    """A module that writes files.

    Attributes:
        SEVERAL: whether a file holds several animations; otherwise each comes into a file of its own.
        TAKES: names of the fields of `Settings`, beyond `fps`, `root_motion` and `names`, that it heeds.
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
        moved: by how much (m) joints moved at most, where a motion's pieces were not rigid; else 0.
    """

    files: tuple[Path, ...]
    moved: float


def export(motion: Motion, path: str | Path, settings: Settings | None = None, **stated: Any) -> Exported:
    """Write one motion ``[T, 22, 3]`` or several ``[S, T, 22, 3]``; see `Settings` for what may be stated by name.

    Raises:
        UserError: an ending that no format has, what the format cannot hold, or a path that cannot be written.
    """
    path, settings = Path(path), replace(settings or Settings(), **stated)
    if path.suffix.lower() not in FORMATS:
        raise UserError(f"'{path}' ends with '{path.suffix}'; {', '.join(FORMATS)} are written")
    form: Format = import_module(f"scenectl.export.{FORMATS[path.suffix.lower()]}")
    motions = [motion] if motion.joints.ndim == 3 else [motion[i] for i in range(len(motion.joints))]
    animations, moved = [], 0.0
    travels = settings.root_motion or settings.character is not None  # whose feet stand where it walks
    for place, one in enumerate(motions):
        animation, by = Animation.of(one, path.stem if len(motions) == 1 else f"{path.stem}_{place}")
        animation = animation if settings.fps is None else animation.resampled(settings.fps)
        animations.append(named(animation if travels else animation.in_place(), settings.names))
        moved = max(moved, by)
    if form.SEVERAL or len(animations) == 1:
        form.write(animations, path, settings)
        return Exported((path,), moved)
    files = tuple(path.with_stem(animation.name) for animation in animations)
    for animation, file in zip(animations, files, strict=True):
        form.write([animation], file, settings)
    return Exported(files, moved)
