"""Signed distances of large scenes: coarse everywhere, as fine as needed near surfaces.

A dense lattice of coarse nodes spans the bounds. Each of its cells may hold a block that divides it into 2, 4 or 8
parts along each axis; where a plain wall is near, the coarse nodes are true to it and no block is needed. This is an
adaptively sampled distance field (Frisken et al., 2000) with a depth that one look-up resolves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from torch import Tensor

from scenes.files import read_arrays
from scenes.kernels.blocks import CELL, LEVELS, STEPS, queried
from scenes.sdf.grid import Interpolated, in_parts, margin_of, stored, stored_place

Blocks: TypeAlias = tuple[np.ndarray, ...]
"""Blocks of 3^3, 5^3 and 9^3 nodes, ``[n, 3, 3, 3]``, ``[n, 5, 5, 5]``, ``[n, 9, 9, 9]`` int16."""


@dataclass(frozen=True, eq=False)
class SdfBlocks(Interpolated):
    """Signed distances on two levels, and their continuous piecewise trilinear interpolant.

    Coarse node ``[i, j, k]`` lies exactly at ``origin + 8 * spacing * (i, j, k)``.

    Attributes:
        coarse: signed distance at the coarse nodes, metres, positive in free space, ``[X, Y, Z]`` float32.
        index: which block a coarse cell has: ``3 * number + level - 1`` with levels 1 to 3 for 2, 4 and 8 parts along
            each axis, -1 for none; ``[X - 1, Y - 1, Z - 1]`` int32.
        blocks: distances at the nodes of blocks of each level, whole multiples of ``spacing / 1024``.
        origin: position of coarse node ``[0, 0, 0]``, metres, world, ``[3]`` float64.
        spacing: between the nodes of the finest blocks, metres.
        beyond: +1 where the space around the grid is free (an object), -1 where it is solid (around a room).
        margin: metres from the border to the nearest surface, or less; as `SdfGrid.margin`.
    """

    coarse: np.ndarray
    index: np.ndarray
    blocks: Blocks
    origin: np.ndarray
    spacing: float
    beyond: float = 1.0
    margin: float = 0.0

    @property
    def widest(self) -> float:
        """Metres between coarse nodes."""
        return CELL * self.spacing

    @property
    def bounds(self) -> np.ndarray:
        """First and last node, ``[2, 3]``, metres."""
        return np.stack([self.origin, self.origin + CELL * self.spacing * np.array(self.index.shape)])

    @property
    def shape(self) -> tuple[int, int, int]:
        """Nodes that a dense grid of this spacing would have along x, y and z."""
        x, y, z = (CELL * n + 1 for n in self.index.shape)
        return x, y, z

    @property
    def nbytes(self) -> int:
        """Bytes in memory."""
        return self.coarse.nbytes + self.index.nbytes + sum(blocks.nbytes for blocks in self.blocks)

    @property
    def finest(self) -> float:
        """Share of the volume that the finest blocks cover."""
        return len(self.blocks[-1]) / self.index.size

    def near(self, points: np.ndarray) -> np.ndarray:
        """Values (m) at world points (m) ``[n, 3]``: where nodes are, as between them."""
        found: np.ndarray = self.distance(torch.from_numpy(points)).numpy()
        return found

    def _evaluate(self, points: Tensor, with_gradient: bool) -> tuple[Tensor, Tensor]:
        """Value ``[n]`` and gradient ``[n, 3]`` at points ``[n, 3]``; on the CPU, wherever the points are."""
        local = points.cpu()
        local = local if local.dtype in (torch.float32, torch.float64) else local.float()
        value, gradient = local.new_empty(len(local)), torch.empty_like(local)
        nodes = (self.origin, CELL * self.spacing, self.coarse, self.index, self.blocks)
        facts = (*nodes, self.beyond, self.outer_margin)
        out = (value.numpy(), gradient.numpy())
        in_parts(len(local), lambda begin, end: queried(local.numpy(), begin, end, *facts, *out))
        return value.to(points), gradient.to(points)

    @cached_property
    def outer_margin(self) -> float:
        """The margin as distances outside take it, see `scenes.sdf.grid.margin_of`."""
        return margin_of(self.coarse, self.margin) if self.beyond > 0 else 0.0

    @cached_property
    def lipschitz(self) -> float:
        """The most by which `distance` changes over a metre, m/m; as `SdfGrid.lipschitz`."""
        steepest = np.ones(3)
        for axis in range(3):
            slopes = [float(np.abs(np.diff(self.coarse, axis=axis)).max()) / (CELL * self.spacing)]
            for level, blocks in enumerate(self.blocks):
                for first in range(0, len(blocks), 1 << 14):
                    rise = np.abs(np.diff(blocks[first : first + (1 << 14)].astype(np.int32), axis=axis + 1)).max()
                    slopes.append(float(rise) / STEPS * (2 << level) / CELL)
            steepest[axis] = max(1.0, *slopes)
        return float(np.linalg.norm(steepest))

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays that `save` writes."""
        return {
            "coarse": self.coarse,
            "index": self.index,
            **{f"blocks{level + 1}": blocks for level, blocks in enumerate(self.blocks)},
            "origin": self.origin,
            "spacing": np.array(self.spacing),
            "beyond": np.array(self.beyond),
            "margin": np.array(self.margin),
        }

    @classmethod
    def load(cls, path: str | Path) -> SdfBlocks:
        """Read a file that `save` wrote; raises UserError for anything else."""
        return read_arrays(path, "grid of distance blocks", cls.from_arrays)

    @classmethod
    def from_arrays(cls, data: Any) -> SdfBlocks:
        """Rebuild from the mapping of arrays that `arrays` gave; raises ValueError where they are unsound.

        Kernels do not check bounds, so that whatever they follow is checked here.
        """
        coarse, index = stored(data, "coarse", np.float32, 3), stored(data, "index", np.int32, 3)
        blocks = tuple(stored(data, f"blocks{level}", np.int16, 4) for level in range(1, LEVELS + 1))
        origin, *place = stored_place(data)
        if min(coarse.shape) < 2 or index.shape != tuple(n - 1 for n in coarse.shape):
            raise ValueError(f"coarse nodes {coarse.shape} and cells {index.shape} do not match")
        for level, of_level in enumerate(blocks):
            if of_level.shape[1:] != ((2 << level) + 1,) * 3:
                raise ValueError(f"blocks of level {level + 1} have shape {of_level.shape}")
            numbers = index[(index >= 0) & (index % LEVELS == level)] // LEVELS
            if numbers.size and numbers.max() >= len(of_level):
                raise ValueError(f"cells refer to blocks of level {level + 1} that are missing")
        return cls(coarse, index, blocks, origin.numpy(), *place)
