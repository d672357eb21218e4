"""Shapes: exact signed distances (checked by what makes a distance one), motion, and CSG."""

from __future__ import annotations

import math

import igl
import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st
from torch import Tensor

from scenes.errors import UserError
from scenes.mesh.primitives import Box, Capsule, Cylinder, Plane, Primitive, Sphere, primitive
from scenes.motion.waypoints import Waypoints
from scenes.sdf.field import DistanceField

SHAPES: list[Primitive] = [
    Box((0.2, 0.5, -0.3), (0.8, 1.0, 0.4), yaw=0.7),
    Sphere((0.1, 0.4, 0.0), 0.6),
    Capsule((-0.3, 0.2, 0.1), (0.5, 0.9, -0.2), 0.25),
    Cylinder((0.0, 0.6, 0.2), 0.4, 1.1),
    Plane((0.0, 0.1, 0.0), (0.3, 2.0, -0.5)),
]
by_name = pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)


def some_points(n: int = 400, seed: int = 0) -> Tensor:
    return 3 * torch.rand(n, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(seed)) - 1.2


@by_name
def test_walking_down_the_gradient_by_the_distance_meets_the_surface(shape: Primitive) -> None:
    points = some_points().requires_grad_()
    distance = shape.distance(points)
    (gradient,) = torch.autograd.grad(distance.sum(), points)
    torch.testing.assert_close(gradient.norm(dim=-1), torch.ones(len(points), dtype=torch.float64))
    foot = points - distance.unsqueeze(-1) * gradient
    torch.testing.assert_close(shape.distance(foot), torch.zeros(len(points), dtype=torch.float64), atol=1e-9, rtol=0)
    assert isinstance(shape, DistanceField)


@by_name
def test_gradcheck_and_float32(shape: Primitive) -> None:
    assert torch.autograd.gradcheck(shape.distance, (some_points(20).requires_grad_(),))
    single = shape.distance(some_points().float())
    assert single.dtype == torch.float32
    torch.testing.assert_close(single, shape.distance(some_points()).float(), atol=1e-6, rtol=0)


@by_name
def test_mesh_has_the_shape_of_the_distance(shape: Primitive) -> None:
    mesh = shape.mesh()
    torch.testing.assert_close(
        shape.distance(torch.tensor(mesh.vertices)),
        torch.zeros(len(mesh.vertices), dtype=torch.float64),
        atol=1e-9,
        rtol=0,
    )
    if isinstance(shape, Plane):
        a, b, c = mesh.triangles[0]
        assert np.dot(np.cross(b - a, c - a), shape.normal) > 0
        return
    points = some_points().numpy()
    exact = shape.distance(torch.from_numpy(points)).numpy()
    squared, _, _ = igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces)
    # Chords cut the curved shapes: a box is exact, the others are within a few millimetres.
    allowed = 1e-9 if isinstance(shape, Box) else 0.01
    assert np.abs(np.sqrt(squared) - np.abs(exact)).max() < allowed
    winding = igl.winding_number(mesh.vertices, mesh.faces, points)
    clear = np.abs(exact) > 0.01
    assert ((winding > 0.5) == (exact < 0))[clear].all()


def test_yaw_turns_z_towards_x() -> None:
    box = Box((0, 0, 0), (0.2, 0.2, 2.0), yaw=math.pi / 2)
    assert box.distance(torch.tensor([[0.9, 0.0, 0.0], [0.0, 0.0, 0.9]])).tolist() == pytest.approx([-0.1, 0.8])


@given(st.lists(st.floats(-5, 5), min_size=3, max_size=3), st.floats(-1, 4))
@settings(max_examples=30, deadline=None)
def test_a_moving_sphere_is_a_sphere_at_the_interpolated_place(point: list[float], time: float) -> None:
    motion = Waypoints((0.5, 1.0, 3.0), ((0, 0, 0), (1, 0, 0), (1, 0, 4)))
    expected = np.array([np.interp(time, motion.times, [p[i] for p in motion.positions]) for i in range(3)])
    still = Sphere((float(expected[0]), float(expected[1]), float(expected[2])), 0.3)
    p = torch.tensor([point], dtype=torch.float64)
    moving = Sphere((9, 9, 9), 0.3, motion)
    torch.testing.assert_close(moving.distance(p, torch.tensor([time], dtype=torch.float64)), still.distance(p))


def test_a_moving_capsule_keeps_its_direction_and_time_broadcasts() -> None:
    still = Capsule((-0.5, 0, 0), (0.5, 0, 0), 0.1)
    moving = Capsule(still.a, still.b, 0.1, Waypoints((0.0, 2.0), ((0, 0, 0), (0, 4, 0))))
    points = torch.rand(3, 5, 7, 3, dtype=torch.float64)
    times = torch.linspace(0, 2, 5, dtype=torch.float64)
    distance = moving.distance(points, times[:, None])
    for frame in range(5):
        shifted = points[:, frame] - torch.tensor([0, 2 * times[frame], 0], dtype=torch.float64)
        torch.testing.assert_close(distance[:, frame], still.distance(shifted))
    torch.testing.assert_close(moving.distance(points), still.distance(points))  # no time means 0 s
    assert moving.distance(points.float(), times[:, None]).dtype == torch.float32


def test_a_capsule_without_length_is_a_sphere() -> None:
    points = some_points(50)
    point = Capsule((0.1, 0.2, 0.3), (0.1, 0.2, 0.3), 0.5)
    torch.testing.assert_close(point.distance(points), Sphere((0.1, 0.2, 0.3), 0.5).distance(points))
    assert np.ptp(point.mesh().bounds, axis=0) == pytest.approx([1.0] * 3, abs=0.01)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Box((0, 0, 0), (1, -1, 1)), "box size is -1"),
        (lambda: Sphere((0, 0, math.nan), 1), "sphere center"),
        (lambda: Sphere((0, 0, 0), 0), "radius is 0"),
        (lambda: Capsule((0, 0, 0), (0, 0), 1), "capsule end b"),
        (lambda: Plane((0, 0, 0), (0, 0, 0)), "plane normal"),
        (lambda: Waypoints((0.0, 0.0), ((0, 0, 0), (1, 0, 0))), "later than the one before"),
        (lambda: Waypoints((0.0,), ()), "1 times and 0 positions"),
        (lambda: primitive("spere", radius=1), "did you mean 'sphere'"),
        (lambda: primitive("sphere", centre=[0, 0, 0], radius=1), "did you mean 'center'"),
        (lambda: primitive("sphere", radius=1), "missing center; it takes center, radius, motion"),
        (lambda: primitive("sphere", center=[0, 0, 0], radius=1, motion={"times": [0]}), "'times' and 'positions'"),
        (lambda: primitive("sphere", center=[0, 0, 0], radius="big"), "radius"),
        (lambda: primitive("sphere", center=["a", 0, 0], radius=1), "center"),
        (lambda: primitive("sphere", center=4, radius=1), "center"),
        (lambda: primitive("box", center=[0, 0, 0], size=[1, 1, 1], yaw="left"), "yaw"),
    ],
)
def test_bad_values_are_one_sentence(build: object, message: str) -> None:
    with pytest.raises(UserError, match=message) as caught:
        build()  # type: ignore[operator]
    assert "\n" not in str(caught.value)


def test_primitives_from_a_task_file() -> None:
    assert primitive("box", center=[0, 1, 2], size=[1, 1, 1]) == Box((0, 1, 2), (1, 1, 1))
    motion = {"times": [0, 1], "positions": [[0, 0, 0], [1, 0, 0]]}
    ball = primitive("sphere", center=[0, 0, 0], radius=1, motion=motion)
    assert ball == Sphere((0, 0, 0), 1, Waypoints((0, 1), ((0, 0, 0), (1, 0, 0))))
