"""What speaks against the signs of a bake, once they are found."""

from __future__ import annotations

import numpy as np

from scenes.errors import UserError
from scenes.mesh.surface import Surface
from scenes.sdf.free_space import Sides
from scenes.sdf.lattice import Lattice
from scenes.sdf.signs import Signs

MUCH = 0.01
"""Share of voxels, or of a surface, from which on contrary evidence is worth a sentence; the scans have none."""


def doubts_about(
    distance: np.ndarray, signs: Signs, sides: Sides, lattice: Lattice, name: str, walls_lost: tuple[str, ...] = ()
) -> tuple[str, ...]:
    """All that speaks against signed distances (m) at the nodes of a lattice, one sentence each.

    Args:
        distance: signed, metres, at the nodes.
        signs: how sure these are.
        sides: by which rule they were found, and its own doubts.
        lattice: of the nodes.
        name: of the mesh.
        walls_lost: what is said of walls that are too thin for the lattice.

    Raises:
        UserError: nothing is free.
    """
    if distance.max() <= 0 > distance.min():
        raise UserError(
            f"mesh '{name}' leaves no free space: all within its bounds is solid; state free_space as a point [x, y, z]"
            ' in the air, or "outside"'
        )
    if sides.sheets is None:
        return (*sides.rule.doubts, *walls_lost)
    if distance.min() >= 0 and sides.solids is None:  # then it does not matter which way they face
        return (
            f"mesh '{name}' encloses nothing, so that all of its space is free, behind its walls too; state thickness"
            " to make them solid, or free_space as a point [x, y, z] in a room's air",
        )
    return (*sides.rule.doubts, *_contrary(distance, signs, sides, sides.sheets, lattice, name), *walls_lost)


def _contrary(
    distance: np.ndarray, signs: Signs, sides: Sides, sheets: Surface, lattice: Lattice, name: str
) -> tuple[str, ...]:
    """Sentences about space that leaks, and about open pieces that face away from free space."""
    found = []
    if sides.seed is None and signs.uncertain is not None and (share := float(signs.uncertain.mean())) >= MUCH:
        found.append(
            f"in mesh '{name}' what is free is uncertain for {100 * share:.0f} % of the voxels, as space leaks through"
            " its holes; look at a slice, and state free_space as a point [x, y, z] in the air where it is wrong"
        )
    if (share := _facing_away(distance, sides, sheets, lattice)) >= MUCH:
        found.append(
            f"{100 * share:.2g} % of the open surface of mesh '{name}' faces away from free space, against the rest; if"
            " that space is wrong, make its normals consistent"
        )
    return tuple(found)


def _facing_away(distance: np.ndarray, sides: Sides, sheets: Surface, lattice: Lattice, samples: int = 1024) -> float:
    """Share of the area in front of which space is solid, and behind which it is free."""
    rng = np.random.default_rng(0)
    chosen = sheets.by_area(samples, rng)
    normal, points = sheets.normals(chosen), sheets.points_on(chosen, rng) + sheets.centre

    def free(away: float) -> np.ndarray:
        node = np.rint((points + away * lattice.spacing * normal - lattice.origin) / lattice.spacing).astype(int)
        clear = (node >= 0).all(axis=1) & (node < lattice.shape).all(axis=1)
        value = distance[tuple(node.clip(0, np.array(lattice.shape) - 1).T)]
        return np.where(clear & (np.abs(value) > lattice.spacing / 2), np.sign(value), 0)

    away = (free(-1.5) > 0) & (free(1.5) < 0)
    if away.mean() >= MUCH:  # unless furniture stands there
        away[away] = sides.out_of_solids(points[away] + 1.5 * lattice.spacing * normal[away])
    return float(away.mean())
