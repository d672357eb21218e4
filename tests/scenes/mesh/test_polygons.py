"""Polygons: triangles cover what the polygon covers, once, and meet their neighbours edge to edge."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from scenes.mesh.polygons import triangulated


def cut(*rings: np.ndarray) -> np.ndarray:
    """Corners of the triangles of some polygons, ``[F, 3, 3]``."""
    vertices = np.concatenate(rings)
    counts = np.array([len(ring) for ring in rings])
    return vertices[triangulated(vertices, np.arange(len(vertices)), counts)]


def vectors(triangles: np.ndarray) -> np.ndarray:
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.cross(b - a, c - a) / 2


def area(ring: np.ndarray) -> float:
    """Of a plane polygon, by the shoelace formula in space."""
    return float(np.linalg.norm(np.cross(ring, np.roll(ring, -1, axis=0)).sum(axis=0)) / 2)


def tilted(flat: np.ndarray, seed: int) -> np.ndarray:
    """A plane polygon ``[n, 2]`` somewhere in space."""
    rng = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.column_stack([flat, np.zeros(len(flat))]) @ turn.T + rng.uniform(-5, 5, 3)


def star(rng: np.random.Generator, corners: int, low: float, high: float) -> np.ndarray:
    """A simple polygon around the origin, concave as a rule, ``[n, 2]``, counter-clockwise."""
    angles = np.linspace(0, 2 * np.pi, corners, endpoint=False) + rng.uniform(0, 0.9 * 2 * np.pi / corners, corners)
    return rng.uniform(low, high, corners)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def covers_once(ring: np.ndarray, triangles: np.ndarray) -> None:
    """Triangles all face the polygon's way and their areas sum to its area: so they neither overlap nor leave it."""
    normals = vectors(triangles)
    whole = normals.sum(axis=0)
    assert len(triangles) == len(ring) - 2
    assert np.linalg.norm(whole) == pytest.approx(area(ring), rel=1e-9)
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(area(ring), rel=1e-9)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(4, 40))
def test_concave_polygons_in_space_are_covered_once(seed: int, corners: int) -> None:
    ring = tilted(star(np.random.default_rng(seed), corners, 0.2, 3.0), seed)
    ring = np.roll(ring, seed % corners, axis=0)
    covers_once(ring, cut(ring))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(3, 12), st.integers(3, 12))
def test_a_bridge_to_a_hole_leaves_the_hole_open(seed: int, outer: int, inner: int) -> None:
    rng = np.random.default_rng(seed)
    around, hole = star(rng, max(outer, 8), 2.0, 3.0), star(rng, inner, 0.3, 0.9)
    keyhole = tilted(np.concatenate([around, around[:1], hole[:1], hole[:0:-1], hole[:1]]), seed)
    flat_area = area(np.column_stack([around, np.zeros(len(around))])) - area(
        np.column_stack([hole, np.zeros(len(hole))])
    )
    triangles = cut(keyhole)
    assert np.linalg.norm(vectors(triangles), axis=1).sum() == pytest.approx(flat_area, rel=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(3, 8), st.integers(1, 3))
def test_corners_in_a_line_stay_corners(seed: int, corners: int, between: int) -> None:
    flat = star(np.random.default_rng(seed), corners, 1.0, 1.2)
    shares = np.arange(between + 1) / (between + 1)
    more = (flat[:, None] * (1 - shares[:, None]) + np.roll(flat, -1, axis=0)[:, None] * shares[:, None]).reshape(-1, 2)
    ring = tilted(more, seed)
    triangles = cut(ring)
    covers_once(ring, triangles)
    assert len(np.unique(triangles.reshape(-1, 3), axis=0)) == len(ring)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(4, 20))
def test_polygons_bent_a_little_keep_their_vector_area(seed: int, corners: int) -> None:
    rng = np.random.default_rng(seed)
    ring = tilted(star(rng, corners, 0.5, 2.0), seed)
    ring += rng.uniform(-0.01, 0.01, ring.shape)
    expected = np.cross(ring, np.roll(ring, -1, axis=0)).sum(axis=0) / 2
    normals = vectors(cut(ring))
    assert normals.sum(axis=0) == pytest.approx(expected, abs=1e-9)  # Stokes: whatever the cut
    assert np.linalg.norm(normals, axis=1).sum() < 1.2 * np.linalg.norm(expected) + 0.05


def test_triangles_and_convex_quadrangles_are_cut_as_ever_and_in_that_order() -> None:
    corners = np.array([0, 1, 2, 3, 4, 5, 6, 0, 2, 3, 1, 2, 6, 5])
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1.0]])
    vertices = np.vstack([vertices, [[0, 1, 1]]])
    faces = triangulated(vertices, corners[[0, 1, 2, 3, 7, 8, 9, 10, 11, 12, 13]], np.array([4, 3, 4]))
    assert faces.tolist() == [[0, 2, 3], [0, 1, 2], [1, 2, 6], [2, 3, 0], [6, 5, 1]]


def test_a_concave_quadrangle_is_cut_along_its_other_diagonal() -> None:
    dart = np.array([[0.0, 0, 0], [2, 0, 0], [0.3, 0.3, 0], [0, 2, 0]])
    for turn in range(4):
        ring = np.roll(dart, turn, axis=0)
        covers_once(ring, cut(ring))


def test_far_from_the_origin_and_among_others() -> None:
    wall = np.array([[0, 0], [2.4, 0], [2.4, 2.1], [3.6, 2.1], [3.6, 0], [6, 0], [6, 3], [0, 3.0]])
    offset = np.array([500_000.0, 0.0, 4_500_000.0])
    rings = [np.column_stack([wall, np.full(8, z)]) + offset for z in range(5)]
    triangles = cut(*rings)
    assert np.linalg.norm(vectors(triangles), axis=1).sum() == pytest.approx(5 * (18 - 1.2 * 2.1), rel=1e-9)


def test_points_lines_flat_polygons_and_crossing_ones_are_no_error() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [0, 1, 0], [np.nan, 0, 0]])
    corners = np.array([0, 0, 1, 0, 1, 2, 3, 0, 1, 2, 3, 2, 0, 1, 4, 2, 0, 1, 4, 5])
    faces = triangulated(vertices, corners, np.array([1, 2, 4, 5, 4, 4]))
    assert faces.shape == (2 + 3 + 2 + 2, 3)
    with pytest.raises(ValueError, match="beyond the 6"):
        triangulated(vertices, np.array([0, 1, 6]), np.array([3]))
    with pytest.raises(ValueError, match="beyond the 6"):
        triangulated(vertices, np.array([0, 1, -1]), np.array([3]))
