"""How good a bake is, against libigl's exact distances and winding numbers."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from scenes.bake import Bake
from scenes.grid import SdfGrid
from scenes.mesh import Mesh
from scenes.surface import Surface


@dataclass(frozen=True)
class Accuracy:
    """Measured on sampled nodes of a bake; flips on all of them.

    Attributes:
        near_nodes: sampled nodes within two voxels of the surface.
        near_error_voxels: largest distance error there, in voxels.
        far_nodes: sampled nodes farther away.
        far_error_voxels: largest distance error there, in voxels.
        sign_errors: sampled nodes whose sign is not that of the exact winding number under the bake's rule.
        impossible_flips: neighbouring nodes of opposite sign that are too far apart for a surface between them.
    """

    near_nodes: int
    near_error_voxels: float
    far_nodes: int
    far_error_voxels: float
    sign_errors: int
    impossible_flips: int

    def row(self) -> dict[str, float | int]:
        """The figures by name, as a table or a JSON file takes them."""
        return asdict(self)


def measure(result: Bake[SdfGrid], mesh: Mesh, samples: int = 20_000, seed: int = 0) -> Accuracy:
    """Compare a bake with the oracle on `samples` nodes, half of them within two voxels of the surface.

    The oracle costs about 50 microseconds a node on a mesh of 60,000 triangles.
    """
    grid, surface = result.grid, Surface.of(mesh)
    values = grid.values.numpy().reshape(-1)
    rng = np.random.default_rng(seed)
    close = np.flatnonzero(np.abs(values) < 2.5 * grid.spacing)
    near = rng.choice(close, min(len(close), samples // 2), replace=False)
    chosen = np.union1d(near, rng.choice(values.size, min(values.size, samples - len(near)), replace=False))
    points = grid.nodes(np.stack(np.unravel_index(chosen, grid.values.shape), axis=-1))
    exact = surface.unsigned_distance(points)
    error = np.abs(np.abs(values[chosen]) - exact) / grid.spacing
    within = exact <= 2 * grid.spacing
    winding = surface.winding(points)
    free = (winding >= result.free[0]) & (winding <= result.free[1])
    # A node that lies on the surface is on neither side of it.
    wrong = (free != (values[chosen] > 0)) & (exact > 1e-3 * grid.spacing)
    return Accuracy(
        near_nodes=int(within.sum()),
        near_error_voxels=float(error[within].max(initial=0.0)),
        far_nodes=int((~within).sum()),
        far_error_voxels=float(error[~within].max(initial=0.0)),
        sign_errors=int(wrong.sum()),
        impossible_flips=impossible_flips(grid),
    )


def impossible_flips(grid: SdfGrid, slack: float = 1.01) -> int:
    """Pairs of neighbouring nodes of opposite sign whose distances sum to more than `slack` voxels.

    A surface between two nodes one voxel apart is within one voxel of both together, so such a pair contradicts
    itself. Closed meshes must have none. Open ones have some where the sign changes across a hole.
    """
    values = grid.values.numpy()
    count = 0
    for axis in range(3):
        ahead = np.moveaxis(values, axis, 0)
        a, b = ahead[:-1], ahead[1:]
        count += int(np.count_nonzero((np.sign(a) * np.sign(b) < 0) & (np.abs(a - b) > slack * grid.spacing)))
    return count
