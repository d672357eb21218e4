"""Where a bake's signs rest on thin evidence: uncertain voxels, and the holes that make them so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from scenectl.view.marks import GOAL
from scenectl.view.shapes import Hull
from scenectl.view.stage import GLOW, Stage, shaded
from scenes.mesh.surface import Surface
from scenes.sdf.bake import Bake
from scenes.sdf.signs import UNCERTAIN
from scenes.world.scene import Scene

_FINEST = 96  # blocks along an axis: finer ones cannot be told apart in a picture
_SCALE = ("dark to bright", (0.0, float(UNCERTAIN)))


@dataclass(frozen=True)
class Blocks:
    """Cubes that hold an uncertain voxel.

    Attributes:
        low: lowest corner of all cubes, m.
        size: of a cube, m.
        agreeing: percent of the evidence that agrees, the least in each cube, ``[X, Y, Z]``; the certain ones are over
            `UNCERTAIN`.
    """

    low: np.ndarray
    size: float
    agreeing: np.ndarray

    def faces(self) -> tuple[np.ndarray, np.ndarray]:
        """Squares between uncertain cubes and others, ``[n, 4, 3]`` m, and the percentage of each one's cube."""
        squares, values = [], []
        inside = np.pad(self.agreeing <= UNCERTAIN, 1)
        percent = np.pad(self.agreeing, 1)
        for axis in range(3):
            across = [np.eye(3)[k] for k in range(3) if k != axis]
            square = np.array([np.zeros(3), across[0], across[0] + across[1], across[1]])
            for step in (1, -1):
                shown = inside & ~np.roll(inside, -step, axis)
                corner = np.argwhere(shown) - 1.0 + (np.eye(3)[axis] if step > 0 else 0.0)
                squares.append(self.low + self.size * (corner[:, None] + square))
                values.append(percent[shown])
        return np.concatenate(squares), np.concatenate(values)


def uncertain_blocks(bake: Bake[Any]) -> Blocks | None:
    """Blocks that hold an uncertain voxel; None without any."""
    confidence = bake.signs.confidence
    if confidence is None or confidence.min() > UNCERTAIN:
        return None
    size = -(-max(confidence.shape) // _FINEST)
    padded = np.pad(confidence, [(0, -n % size) for n in confidence.shape], constant_values=100)
    shape = [n // size for n in padded.shape]
    least = padded.reshape(shape[0], size, shape[1], size, shape[2], size).min(axis=(1, 3, 5))
    low, high = bake.grid.bounds
    spacing = float(high[0] - low[0]) / (confidence.shape[0] - 1)
    return Blocks(low - spacing / 2, size * spacing, least)  # a node stands for the voxel around it


def draw_evidence(stage: Stage, scene: Scene) -> None:
    """Uncertain voxels, coloured by how much of the evidence agrees, the holes in meshes, and the summaries."""
    summaries = []
    for mesh, result in zip(scene.meshes, scene.bakes, strict=True):
        if (blocks := uncertain_blocks(result)) is not None:
            squares, values = blocks.faces()
            corners = squares[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
            colours = np.repeat(shaded(values, *_SCALE), 6, axis=0)
            stage.add(Hull(corners), colours, GLOW, 0.35)
            stage.add_scale("agreeing evidence (%)", *_SCALE, (0.7, 0.03))
        edges = Surface.of(mesh).open_edges
        if len(edges):
            stage.add_lines(edges.reshape(-1, 3), np.arange(2 * len(edges)).reshape(-1, 2), GOAL, 2.0)
        summaries.append(f"{mesh.name}: {result.signs.summary}")
    if summaries:
        stage.add_text("\n".join(summaries), (0.015, 0.02), 24)
