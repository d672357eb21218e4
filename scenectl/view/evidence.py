"""Where a bake's signs rest on thin evidence: uncertain voxels, and the holes that make them so."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from scenectl.view.marks import GOAL
from scenectl.view.stage import say, scaled
from scenes.mesh.surface import Surface
from scenes.sdf.bake import Bake
from scenes.sdf.signs import UNCERTAIN
from scenes.world.scene import Scene

if TYPE_CHECKING:
    from pyvista import Plotter, UnstructuredGrid

_FINEST = 96  # blocks along an axis: finer ones cannot be told apart in a picture
_AGREEING = "agreeing evidence (%)"


def uncertain_blocks(bake: Bake[Any]) -> UnstructuredGrid | None:
    """Cubes that hold an uncertain voxel, with the least percentage of evidence that agrees; None without any."""
    from pyvista import ImageData

    confidence = bake.signs.confidence
    if confidence is None or confidence.min() > UNCERTAIN:
        return None
    size = -(-max(confidence.shape) // _FINEST)
    padded = np.pad(confidence, [(0, -n % size) for n in confidence.shape], constant_values=100)
    shape = [n // size for n in padded.shape]
    least = padded.reshape(shape[0], size, shape[1], size, shape[2], size).min(axis=(1, 3, 5))
    low, high = bake.grid.bounds
    spacing = float(high[0] - low[0]) / (confidence.shape[0] - 1)
    blocks = ImageData(
        dimensions=[n + 1 for n in shape],
        spacing=[size * spacing] * 3,
        origin=low - spacing / 2,  # a node stands for the voxel around it
    )
    blocks.cell_data[_AGREEING] = least.ravel(order="F")
    return blocks.threshold([0, UNCERTAIN], scalars=_AGREEING)


def draw_evidence(stage: Plotter, scene: Scene) -> None:
    """Uncertain voxels, coloured by how much of the evidence agrees, the holes in meshes, and the summaries."""
    summaries = []
    for mesh, result in zip(scene.meshes, scene.bakes, strict=True):
        if (blocks := uncertain_blocks(result)) is not None:
            stage.add_mesh(
                blocks, **scaled(_AGREEING, "plasma", (0.0, float(UNCERTAIN)), 0.7), opacity=0.35, lighting=False
            )
        edges = Surface.of(mesh).open_edges
        if len(edges):
            stage.add_lines(edges.reshape(-1, 3), color=GOAL, width=2)
        summaries.append(f"{mesh.name}: {result.signs.summary}")
    say(stage, "\n".join(summaries), (0.015, 0.02), 12)
