"""Fitted capsules hold what they promise, are small, and follow what they are fitted to."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from scenes.body.capsules import enclosed_volume, fit_capsule, inner_volume, sample_surface
from scenes.errors import UserError
from scenes.mesh.primitives import Box, Capsule, Cylinder, Sphere


def blob(seed: int, count: int = 60) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(count, 3)) * rng.uniform(0.03, 0.4, size=3) + rng.normal(size=3)


def naive_distance(points: np.ndarray, a: tuple[float, ...], b: tuple[float, ...], radius: float) -> np.ndarray:
    """Against ten thousand balls along the segment."""
    share = np.linspace(0, 1, 10_000)[:, None]
    centres = (1 - share) * np.array(a) + share * np.array(b)
    return np.array([np.linalg.norm(centres - p, axis=1).min() for p in points]) - radius


@pytest.mark.parametrize(("length", "radius"), [(0.5, 0.05), (0.3, 0.2), (0.05, 0.1)])
def test_a_capsule_is_fitted_by_itself(length: float, radius: float) -> None:
    mesh = Capsule((0.1, 0.2, 0.3), (0.1, 0.2 + 0.6 * length, 0.3 + 0.8 * length), radius).mesh()
    found = fit_capsule(mesh.vertices, faces=mesh.faces)
    assert found.reference == "mesh"
    assert found.volume == pytest.approx(math.pi * radius**2 * (length + 4 / 3 * radius), rel=1e-5)
    assert 1.0 <= found.volume_ratio < 1.02  # the triangles lie within the capsule that they stand for
    assert (found.length, found.radius) == pytest.approx((length, radius), rel=1e-4)
    assert found.uncovered < 1e-9


def test_a_ball_is_fitted_by_a_ball_and_a_box_by_its_long_axis() -> None:
    ball = fit_capsule(Sphere((1.0, 2.0, 3.0), 0.3).mesh().vertices)
    assert ball.length == pytest.approx(0, abs=1e-4) and ball.radius == pytest.approx(0.3, rel=1e-4)
    box = fit_capsule(Box((0, 0, 0), (1.0, 0.1, 0.1)).mesh().vertices)
    # through the corners of the square ends: r = half a diagonal, or a longer one with caps that need not reach as far
    assert abs(np.array(box.b) - box.a)[0] == pytest.approx(box.length, rel=1e-6)
    assert box.volume <= math.pi * 0.005 * (1.0 + 4 / 3 * math.sqrt(0.005))


@pytest.mark.parametrize("seed", range(8))
def test_nothing_sticks_out_of_a_whole_cover_and_nothing_smaller_is_near(seed: int) -> None:
    points = blob(seed)
    found = fit_capsule(points)
    assert naive_distance(points, found.a, found.b, found.radius).max() < 1e-6
    assert found.uncovered <= 1e-9
    rng = np.random.default_rng(seed)
    for _ in range(200):
        a, b = (np.array(end) + rng.normal(size=3) * 0.01 for end in (found.a, found.b))
        radius = max(0.0, naive_radius(points, a, b))
        volume = math.pi * radius**2 * (float(np.linalg.norm(b - a)) + 4 / 3 * radius)
        assert volume >= found.volume * (1 - 1e-6)


def naive_radius(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    share = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-30), 0, 1)
    return float(np.linalg.norm(points - a - share[:, None] * (b - a), axis=1).max())


@pytest.mark.parametrize("seed", range(4))
def test_no_direction_of_a_fine_fan_gives_a_much_smaller_capsule(seed: int) -> None:
    """An independent search: 2000 random axes through the middle, ends slid in as far as they go."""
    points = blob(seed)
    rng, best = np.random.default_rng(seed), math.inf
    for direction in rng.normal(size=(2000, 3)):
        u = direction / np.linalg.norm(direction)
        middle = points.mean(axis=0)
        along = (points - middle) @ u
        away = np.linalg.norm(points - middle - along[:, None] * u, axis=1)
        cap = np.sqrt(np.maximum(away.max() ** 2 - away**2, 0.0))
        length = max(0.0, float((along - cap).max() - (along + cap).min()))
        best = min(best, math.pi * away.max() ** 2 * (length + 4 / 3 * away.max()))
    assert fit_capsule(points).volume <= best


@given(st.integers(0, 10_000), st.floats(0.5, 1.0, exclude_min=True))
@settings(max_examples=8, deadline=None)
def test_a_share_of_the_points_is_held_by_a_capsule_that_is_no_larger(seed: int, coverage: float) -> None:
    points = blob(seed)
    found, whole = fit_capsule(points, coverage), fit_capsule(points)
    inside = (found.distance(points) <= 1e-6).mean()
    assert inside >= coverage - 1e-9
    assert found.volume <= whole.volume * (1 + 1e-4)
    assert found.uncovered == pytest.approx(
        max(0.0, naive_distance(points, found.a, found.b, found.radius).max()), abs=1e-4
    )


@pytest.mark.parametrize("coverage", [1.0, 0.9])
@pytest.mark.parametrize("seed", range(4))
def test_a_capsule_moves_turns_and_grows_with_its_points(seed: int, coverage: float) -> None:
    points = blob(seed)
    turn, shift, scale = Rotation.random(random_state=seed).as_matrix(), np.array([5.0, -3.0, 40.0]), 7.0
    found, moved = fit_capsule(points, coverage), fit_capsule(scale * points @ turn.T + shift, coverage)
    # which points are left out is a local choice that the last digits may turn
    assert moved.volume == pytest.approx(scale**3 * found.volume, rel=1e-3 if coverage == 1 else 0.05)
    if coverage == 1:
        ends = {tuple(np.round(scale * np.array(end) @ turn.T + shift, 2)) for end in (found.a, found.b)}
        assert ends == {tuple(np.round(end, 2)) for end in (moved.a, moved.b)}


def test_flat_and_thin_things_have_capsules_too() -> None:
    plate = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0.5], [0, 0, 0.5]])
    flat = fit_capsule(plate, faces=np.array([[0, 1, 2], [0, 2, 3]]))
    assert math.isinf(flat.volume_ratio) and flat.uncovered < 1e-9 and flat.reference == "hull"
    line = fit_capsule(np.array([[0.0, 0, 0], [3, 0, 0], [1, 0, 0]]))
    assert (line.length, line.radius, line.volume, line.uncovered) == (3.0, 0.0, 0.0, 0.0)
    point = fit_capsule(np.full((4, 3), 2.0))
    assert (point.a, point.length, point.radius) == ((2.0, 2.0, 2.0), 0.0, 0.0)
    tiny = fit_capsule(1e-4 * blob(1))
    assert tiny.volume == pytest.approx(1e-12 * fit_capsule(blob(1)).volume, rel=1e-3)


@pytest.mark.parametrize(
    ("points", "coverage", "sentence"),
    [
        (np.zeros((0, 3)), 1.0, r"shape \[0, 3\]"),
        (np.zeros((5, 2)), 1.0, r"shape \[5, 2\]"),
        (np.full((5, 3), np.nan), 1.0, "NaN"),
        (np.eye(3), 0.5, "coverage is 0.5"),
        (np.eye(3), 1.01, "coverage is 1.01"),
    ],
)
def test_what_cannot_be_fitted_is_told(points: np.ndarray, coverage: float, sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        fit_capsule(points, coverage)


def test_volumes_are_those_inside_closed_triangles_and_else_of_the_hull() -> None:
    mesh = Cylinder((4, 5, 6), 0.5, 2.0).mesh()
    area = 48 / 2 * 0.25 * math.sin(2 * math.pi / 48)
    assert enclosed_volume(mesh.vertices, mesh.faces) == pytest.approx(2 * area)
    assert enclosed_volume(mesh.vertices, mesh.faces[:, ::-1].copy()) == pytest.approx(2 * area)
    assert enclosed_volume(mesh.vertices, mesh.faces[1:]) is None
    assert inner_volume(mesh.vertices, mesh.faces[1:]) == (pytest.approx(2 * area), "hull")
    twice = np.concatenate([mesh.faces, mesh.faces + len(mesh.vertices)])  # a second shell nearly in the same place
    volume, reference = inner_volume(np.concatenate([mesh.vertices, mesh.vertices + 0.01]), twice)
    assert reference == "hull" and volume < 2.2 * area


def test_samples_lie_on_triangles_in_proportion_to_their_area() -> None:
    vertices = np.array([[0.0, 0, 0], [3, 0, 0], [0, 1, 0], [0, 0, 5], [1, 0, 5], [0, 1, 5]])
    points = sample_surface(vertices, np.array([[0, 1, 2], [3, 4, 5]]), 4000)
    assert (points[:, 2] == 0).mean() == pytest.approx(0.75, abs=0.01)
    low = points[points[:, 2] == 0]
    assert (low >= 0).all() and (low[:, 0] / 3 + low[:, 1] <= 1 + 1e-12).all()
    assert low.mean(axis=0) == pytest.approx([1, 1 / 3, 0], abs=0.05)
