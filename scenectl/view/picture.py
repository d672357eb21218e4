"""Pictures: a scene, a person over time, goals, and what is said of them, in a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from scenectl.view.sheet import Extras, compose
from scenectl.view.stage import SIZE, write
from scenectl.view.staging import Staging


@dataclass(frozen=True)
class Picture(Staging):
    """Something to look at."""

    def draw(
        self,
        png: str | Path,
        at: float | None = None,
        show_slice: bool = False,
        clearance: bool = False,
        show_signs: bool = False,
        size: tuple[int, int] = SIZE,
    ) -> None:
        """Render into a PNG file, off screen.

        Args:
            png: the file, written whole or not at all.
            at: one moment (s) instead of several over the motion.
            show_slice: the distance field on a horizontal plane at hip height.
            clearance: colour the body by its distance to the scene.
            show_signs: where it is uncertain whether space is free, and the holes in meshes.
            size: pixels.
        """
        write(compose(self, self.moments(at), size, Extras(show_slice, clearance, show_signs)), png)
