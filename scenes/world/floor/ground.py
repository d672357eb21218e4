"""How high the floor lies: the lowest large level of some meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scenes.errors import UserError
from scenes.mesh.mesh import Mesh


@dataclass(frozen=True)
class Floor:
    """Where soles stand.

    Attributes:
        height: y of the floor, metres.
        found: True where it was found in the meshes, False where the user stated it.
        area: up-facing area (m²) within 5 cm of it, the evidence; 0 where it was stated.
    """

    height: float
    found: bool
    area: float = 0.0


def find_floor(meshes: Sequence[Mesh]) -> Floor:
    """The lowest large horizontal level of some meshes.

    A histogram over height of the area of all triangles that face up within 30 degrees (in a scan that faces inward
    the floor does as well); of its peaks the lowest counts that has at least a third of the largest one's area, so
    that neither a table nor a roof is taken for the floor; refined to the area-weighted median around it.

    Raises:
        UserError: nothing faces up.
    """
    heights, areas = _facing_up(meshes)
    if areas.sum() <= 0:
        names = ", ".join(f"'{mesh.name}'" for mesh in meshes) or "an empty scene"
        raise UserError(f"found no floor in {names} because nothing faces up; state its height with floor = …")
    width = 0.02
    bins = np.floor((heights - heights.min()) / width).astype(int)
    histogram = np.bincount(bins, weights=areas, minlength=int(bins.max()) + 1)
    level = np.convolve(np.pad(histogram, 2), np.ones(5), mode="valid")  # area within 5 cm of each bin
    first = int(np.argmax(level >= level.max() / 3))
    peak = first + int(np.argmax(level[first : first + 6]))  # the slope of a noisy floor starts lower
    near = np.abs(heights - (heights.min() + (peak + 0.5) * width)) <= 0.05
    order = np.argsort(heights[near], kind="stable")
    total = np.cumsum(areas[near][order])
    middle = heights[near][order][np.searchsorted(total, total[-1] / 2)]
    return Floor(height=float(middle), found=True, area=float(total[-1]))


def _facing_up(meshes: Sequence[Mesh]) -> tuple[np.ndarray, np.ndarray]:
    """Mean height (m) and area (m²) of every triangle whose normal is within 30 degrees of up."""
    heights, areas = [np.zeros(0)], [np.zeros(0)]
    for mesh in meshes:
        a, b, c = (mesh.triangles[:, k] for k in range(3))
        normal = np.cross(b - a, c - a) / 2
        area = np.linalg.norm(normal, axis=1)
        up = normal[:, 1] > np.cos(np.radians(30.0)) * area
        heights.append(mesh.triangles[up, :, 1].mean(axis=1))
        areas.append(area[up])
    return np.concatenate(heights), np.concatenate(areas)
