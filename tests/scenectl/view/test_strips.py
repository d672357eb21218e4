"""Strips of poses: nobody leaves the picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from scenectl.view.strips import draw_strips
from scenes.motion.skeleton import HUMANML3D


def test_who_climbs_or_descends_stays_in_the_picture(tmp_path: Path) -> None:
    pose = np.zeros((22, 3))
    for joint, parent in enumerate(HUMANML3D.parents):
        if parent >= 0:
            pose[joint] = pose[parent] + HUMANML3D.offsets[joint]
    pose[:, 1] -= pose[:, 1].min()

    def drawn(up: float) -> tuple[int, int]:
        """Height of the picture, and how many of its columns show a left side."""
        rising = pose + np.linspace(0.0, up, 30)[:, None, None] * [0, 1, 0]
        draw_strips([("a person", rising)], tmp_path / "strips.png")
        with Image.open(tmp_path / "strips.png") as picture:
            seen = np.asarray(picture.convert("RGB")).astype(int)
        return len(seen), int((np.abs(seen - [0x2F, 0x6F, 0xB0]).sum(-1) < 60).any(0).sum())

    height, columns = drawn(0.0)
    for up in (3.0, -1.0):
        taller, same = drawn(up)
        assert taller > 1.3 * height and abs(same - columns) <= 0.1 * columns
