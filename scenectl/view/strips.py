"""Strips: the poses of a motion side by side, one motion a row. Quick to draw, and all of a motion at a glance."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from scenes.files import atomic_write
from scenes.motion.skeleton import HUMANML3D

_LEFT, _RIGHT, _TRUNK = "#2f6fb0", "#c0392b", "#3a3a3a"
_VIEW = np.deg2rad(50.0)
"""Angle between the way the person first faces and the line of sight: steps and arms both show."""
_APART = 1.25
_POINTS_A_METRE = 38.0
_HEIGHTS = -0.08, 2.1
"""Of a row at least (m), which shows more where people climb."""


def draw_strips(rows: Sequence[tuple[str, Float[np.ndarray, "T 22 3"]]], png: str | Path, poses: int = 12) -> None:
    """Draw motions as rows of poses into a PNG file.

    Left limbs are blue, right ones red; each pose stands under its own pelvis, so distances travelled do not show.

    Args:
        rows: a caption and the joints (metres, world) of each motion, which first faces +z.
        png: the file, written whole or not at all.
        poses: how many of each, evenly spaced in time.
    """
    from matplotlib.figure import Figure  # without pyplot, so that no window system is asked for

    heights = [_heights(joints) for _, joints in rows]
    shares = [(high - low) / (_HEIGHTS[1] - _HEIGHTS[0]) for low, high in heights]
    size = poses * _APART * _POINTS_A_METRE / 72 + 0.4, 1.55 * sum(shares)
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(len(rows), 1, squeeze=False, height_ratios=shares)[:, 0]
    for axis, (caption, joints), height in zip(axes, rows, heights, strict=True):
        _draw_row(axis, joints, poses, height)
        axis.set_title(caption, fontsize=7, loc="left", pad=2)
    with atomic_write(png) as file:
        figure.savefig(file, format="png", dpi=110)


def _heights(joints: Float[np.ndarray, "T 22 3"]) -> tuple[float, float]:
    """What a row has to show, from the ground that the motion begins on."""
    low, high = float(joints[..., 1].min()), float(joints[..., 1].max())
    return min(_HEIGHTS[0], low + _HEIGHTS[0]), max(_HEIGHTS[1], high - _HEIGHTS[0])


def _draw_row(axis: Any, joints: Float[np.ndarray, "T 22 3"], poses: int, heights: tuple[float, float]) -> None:
    for i, frame in enumerate(np.linspace(0, len(joints) - 1, poses).round().astype(int)):
        pose = joints[frame] - joints[frame, 0] * [1, 0, 1]
        across = pose[:, 0] * np.cos(_VIEW) + pose[:, 2] * np.sin(_VIEW) + i * _APART
        away = pose[:, 2] * np.cos(_VIEW) - pose[:, 0] * np.sin(_VIEW)
        for parent, child in HUMANML3D.bones:
            name = HUMANML3D.names[child]
            colour = _LEFT if "left" in name else _RIGHT if "right" in name else _TRUNK
            nearness = -float(away[child] + away[parent])
            ends = across[[parent, child]], pose[[parent, child], 1]
            axis.plot(*ends, color=colour, linewidth=2.2, solid_capstyle="round", zorder=3 + nearness)
    axis.axhline(0.0, color="#b8b8b8", linewidth=0.8, zorder=0)
    axis.set(xlim=(-0.8, (poses - 1) * _APART + 0.8), ylim=heights, aspect="equal")
    axis.axis("off")
