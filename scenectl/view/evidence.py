"""Where a bake's signs rest on thin evidence: uncertain voxels, and the holes that make them so."""

from __future__ import annotations

from typing import Any

import numpy as np

from scenes.sdf.bake import Bake
from scenes.sdf.signs import UNCERTAIN

_FINEST = 96  # blocks along an axis: finer ones cannot be told apart in a picture


def uncertain_blocks(bake: Bake[Any]) -> Any:
    """Blocks that hold an uncertain voxel, as VTK cells with the percent of evidence that agrees; None without any."""
    import pyvista as pv

    confidence = bake.signs.confidence
    if confidence is None or confidence.min() > UNCERTAIN:
        return None
    size = -(-max(confidence.shape) // _FINEST)
    padded = np.pad(confidence, [(0, -n % size) for n in confidence.shape], constant_values=100)
    shape = [n // size for n in padded.shape]
    least = padded.reshape(shape[0], size, shape[1], size, shape[2], size).min(axis=(1, 3, 5))
    low, high = bake.grid.bounds
    spacing = float(high[0] - low[0]) / (confidence.shape[0] - 1)
    blocks = pv.ImageData(
        dimensions=[n + 1 for n in shape],
        spacing=[size * spacing] * 3,
        origin=low - spacing / 2,  # a node stands for the voxel around it
    )
    blocks.cell_data["agreeing evidence (%)"] = least.ravel(order="F")
    return blocks.threshold([0, UNCERTAIN], scalars="agreeing evidence (%)")


def open_edges(segments: np.ndarray) -> Any:
    """Segments ``[n, 2, 3]`` as VTK lines; None without any."""
    import pyvista as pv

    if len(segments) == 0:
        return None
    lines = np.column_stack([np.full(len(segments), 2), np.arange(2 * len(segments)).reshape(-1, 2)])
    return pv.PolyData(segments.reshape(-1, 3), lines=lines.ravel())
