"""Open patches that share no edge, turned to face alike: a wall of a room that was drawn the other way.

What the other patches add to the winding number changes across a patch as its own part does, where all bound the same
space: it falls from behind a wall to its front. As with magnets side by side, a patch that faces against the field of
the others is turned.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scenes.kernels import weld
from scenes.mesh.surface import Surface

SMALL = 0.02
"""Share of the area from which on a patch is asked: what is smaller decides little, and there may be thousands."""

MOST = 24
"""Patches that are asked, the largest: their winding numbers are exact, so that each costs a look at every triangle."""

_SAMPLES = 8  # points of a patch
_STEP = 0.01  # from them to both sides, of the square root of its area
_BETWEEN = 0.3  # change of the winding number within such a step that tells of another surface between
_FIELD = 2e-3  # change that counts; a wall of a room of 5 x 4 m sees 0.01 and more


def aligned(surface: Surface) -> Surface:
    """The same triangles with every patch that faces against the others turned."""
    every = np.concatenate([surface.faces, surface.slivers])
    keys = weld.edge_keys(every, len(surface.vertices))
    of_face, count = weld.patched(keys, np.argsort(keys))
    patch = of_face[: len(surface.faces)]
    area = np.bincount(patch, weld.areas(surface.vertices, surface.faces), count)
    some = np.argsort(-area, kind="stable")[:MOST]
    some = some[area[some] >= SMALL * area.sum()]
    if len(some) < 2:
        return surface
    facing = _settled(_across(surface, patch, area, some), area[some])
    wrong = np.zeros(count, dtype=bool)
    wrong[some] = facing < 0
    if not wrong.any():
        return surface
    turned = wrong[of_face]
    every[turned] = every[turned][:, ::-1]
    faces, slivers = every[: len(patch)], every[len(patch) :]
    return replace(surface, faces=faces, slivers=slivers, turned=surface.turned + int(turned.sum()))


def _across(surface: Surface, patch: np.ndarray, area: np.ndarray, some: np.ndarray) -> np.ndarray:
    """How much the winding number about patch q changes from behind patch p to its front: ``[p, q]``."""
    rng = np.random.default_rng(0)
    points = np.zeros((2, len(some), _SAMPLES, 3))
    parts = [surface.part(surface.faces[patch == p], faults=surface.faults) for p in some]
    for place, part in enumerate(parts):
        chosen = part.by_area(_SAMPLES, rng)
        step = _STEP * np.sqrt(area[some[place]]) * part.normals(chosen)
        middle = part.points_on(chosen, rng) + surface.centre
        points[:, place] = middle + step, middle - step
    change = np.zeros((len(some), len(some)))
    for q, part in enumerate(parts):
        front, behind = part.winding(points.reshape(-1, 3)).reshape(2, len(some), _SAMPLES)
        found = np.where(np.abs(front - behind) > _BETWEEN, 0.0, front - behind)
        change[:, q] = found.mean(axis=1)
    np.fill_diagonal(change, 0.0)
    return change


def _settled(change: np.ndarray, area: np.ndarray) -> np.ndarray:
    """1 or -1 for each patch: the one most against the field of the others is turned until none is."""
    facing = np.ones(len(area))
    for _ in range(2 * len(area)):
        against = facing * (change @ facing)
        worst = int(against.argmax())
        if against[worst] <= _FIELD:
            break
        facing[worst] *= -1
    return facing if (area * facing).sum() >= 0 else -facing
