"""The interpolant: exact on what it can represent, exact gradients, and sane outside the grid."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st
from torch import Tensor

from scenes.errors import UserError
from scenes.mesh.csg import csg
from scenes.mesh.mesh import Mesh, load_mesh
from scenes.mesh.primitives import Box, Sphere
from scenes.mesh.surface import Surface
from scenes.sdf import grid as grids
from scenes.sdf.bake import bake
from scenes.sdf.grid import CROWDED, SdfGrid, interpolate
from scenes.sdf.lattice import Lattice

ORIGIN, SPACING, SHAPE = (-0.3, 1.2, 5.0), 0.17, (5, 4, 6)


AROUND = [(1.0, 0.0), (-1.0, 0.0), (1.0, 0.3), (-1.0, 0.3)]
"""What lies around a grid: the sign beyond, and the margin."""


def random_grid(beyond: float = 1.0, margin: float = 0.0) -> SdfGrid:
    """Noise; with a margin, noise that is free and no less than that at the border."""
    values = torch.randn(SHAPE, generator=torch.Generator().manual_seed(1))
    values = values.abs() + 2 * margin if margin else values
    return SdfGrid(values, torch.tensor(ORIGIN, dtype=torch.float64), SPACING, beyond, margin)


def points_around(grid: SdfGrid, n: int, margin: float = 0.0, seed: int = 2) -> Tensor:
    low, high = torch.from_numpy(grid.bounds)
    u = torch.rand(n, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
    return low - margin + u * (high - low + 2 * margin)


def test_multilinear_functions_are_reproduced_at_their_own_place() -> None:
    # 1, x, y, z, xy, ..., xyz span what trilinear interpolation holds; a node offset or an axis swap would show.
    def function(p: Tensor) -> Tensor:
        x, y, z = p.unbind(-1)
        return 0.3 + x - 2 * y + 0.5 * z + x * y - 0.7 * y * z + 0.2 * x * z + 0.4 * x * y * z

    index = torch.cartesian_prod(*(torch.arange(n, dtype=torch.float64) for n in SHAPE))
    nodes = torch.tensor(ORIGIN, dtype=torch.float64) + SPACING * index
    grid = SdfGrid(function(nodes).reshape(SHAPE), torch.tensor(ORIGIN, dtype=torch.float64), SPACING)
    points = points_around(grid, 200).requires_grad_()
    value = grid.distance(points)
    torch.testing.assert_close(value, function(points), atol=3e-6, rtol=0)
    (gradient,) = torch.autograd.grad(value.sum(), points)
    (expected,) = torch.autograd.grad(function(points).sum(), points)
    torch.testing.assert_close(gradient, expected, atol=3e-5, rtol=0)


def test_equals_grid_sample_inside() -> None:
    grid = random_grid()
    points = points_around(grid, 300)
    low, high = torch.from_numpy(grid.bounds)
    unit = (2 * (points - low) / (high - low) - 1).flip(-1)  # grid_sample wants z, y, x
    expected = torch.nn.functional.grid_sample(
        grid.values.double()[None, None], unit[None, None, None], align_corners=True
    )
    torch.testing.assert_close(grid.distance(points), expected[0, 0, 0, 0], atol=1e-12, rtol=0)


@pytest.mark.parametrize(("beyond", "margin"), AROUND)
def test_gradcheck_inside_and_outside(beyond: float, margin: float) -> None:
    grid = random_grid(beyond, margin)
    points = points_around(grid, 60, margin=0.5).requires_grad_()
    outside = (points.detach() != points.detach().clamp(*torch.from_numpy(grid.bounds))).any(-1)
    assert 10 < int(outside.sum()) < 55
    assert torch.autograd.gradcheck(grid.distance, (points,))


@pytest.mark.parametrize(("beyond", "margin"), AROUND)
def test_continuous_across_the_border_and_outside_as_it_says(beyond: float, margin: float) -> None:
    grid = random_grid(beyond, margin)
    low, high = torch.from_numpy(grid.bounds)
    for axis in range(3):
        border = points_around(grid, 50)
        border[:, axis] = high[axis]
        step = torch.zeros(3, dtype=torch.float64)
        step[axis] = 1e-9
        torch.testing.assert_close(grid.distance(border - step), grid.distance(border + step), atol=1e-6, rtol=0)
    points = points_around(grid, 400, margin=5.0)
    nearest = points.clamp(low, high)
    away, v = (points - nearest).norm(dim=-1), grid.distance(nearest)
    beside = 2 * margin * (points - nearest).abs().sum(-1)
    free = (away.square() + v.square() + beside).sqrt() if beyond > 0 else v - away
    solid = v + beyond * away
    assert margin or 100 < int((v > 0).sum()) < 300
    torch.testing.assert_close(grid.distance(points), torch.where(v > 0, free, solid), atol=1e-9, rtol=0)


@pytest.mark.parametrize(("beyond", "margin"), AROUND)
def test_slopes_hold_across_the_border_and_outside(beyond: float, margin: float) -> None:
    grid = random_grid(beyond, margin)
    p = points_around(grid, 4000, margin=0.5)
    q = p + 0.01 * torch.nn.functional.normalize(torch.randn_like(p), dim=-1)
    assert ((grid.distance(p) - grid.distance(q)).abs() <= 0.01 * grid.lipschitz + 1e-12).all()
    far = SdfGrid(torch.full(SHAPE, 0.3), grid.origin, SPACING, beyond)
    p = points_around(far, 4000, margin=20.0)
    away = (p - p.clamp(*torch.from_numpy(far.bounds))).norm(dim=-1)
    assert (beyond * far.distance(p) >= away - 0.3 - 1e-6).all()  # it never stops growing


@given(
    st.lists(st.tuples(*[st.floats(-0.6, 0.6)] * 3, *[st.floats(0.05, 0.8)] * 3), min_size=1, max_size=3),
    st.integers(8, 40),
    st.floats(0.0, 0.3),
)
@settings(max_examples=25, deadline=None)
def test_outside_distances_are_never_too_large(boxes: list[tuple[float, ...]], resolution: int, padding: float) -> None:
    """By no more, that is, than the grid's own at the point of its border that counts."""
    mesh = csg("union", *(Box(box[:3], box[3:]) for box in boxes))
    grid, surface = bake(mesh, resolution, padding, cache=None).grid, Surface.of(mesh)
    low, high = torch.from_numpy(grid.bounds)
    points = points_around(grid, 400, margin=2.0, seed=resolution)
    nearest = points.clamp(low, high)
    found, border = grid.distance(points).numpy(), grid.distance(nearest).numpy()
    exact, there = surface.unsigned_distance(points.numpy()), surface.unsigned_distance(nearest.numpy())
    own = np.maximum(border - there, 0.0)
    assert (found <= exact + own * np.minimum(border / np.maximum(found, 1e-9), 1.0) + 1e-6).all()
    away = (points - nearest).norm(dim=-1).numpy()
    assert (found >= np.maximum(away, border) - grid.spacing)[away > 0].all()


def test_the_sofa_of_the_shared_cases_is_nowhere_too_far(shared: Path) -> None:
    path = shared / "cases" / "geometry" / "outside_grid_too_far" / "sofa.ply"
    if not path.is_file():
        pytest.skip("the shared cases are not here")
    mesh = load_mesh(path)
    grid, surface = bake(mesh, cache=None).grid, Surface.of(mesh)
    points = np.random.default_rng(0).uniform([-2, -1, -2], [5, 2, 5], (20_000, 3))
    exact, found = surface.unsigned_distance(points), grid.distance(torch.from_numpy(points)).numpy()
    assert np.mean((exact - found) / exact) < 0.02
    assert (found - exact).max() < 1e-3  # the interpolant's own voxel² / 4 distance, at the border


def test_beside_a_box_the_distance_is_right_far_away() -> None:
    box = Box((0.2, 0.1, 0.0), (0.5, 0.3, 0.7))
    grid = bake(box.mesh(), 32, cache=None).grid
    assert grid.margin == pytest.approx(0.1) and grid.outer_margin == pytest.approx(0.1, abs=1e-6)
    for axis in range(3):
        points = torch.tensor([box.center], dtype=torch.float64).repeat(50, 1)
        points[:, axis] += torch.linspace(box.size[axis] / 2, 30.0, 50, dtype=torch.float64)
        short = box.distance(points) - grid.distance(points)  # nodes reach farther than the padding by half a voxel
        assert short[1:].min() > -1e-5 and short.max() <= (1e-5 if axis == 2 else grid.spacing / 2 + 1e-5)
    thick = bake(box.mesh(), 32, cache=None, thickness=0.05).grid
    assert thick.margin == pytest.approx(0.1)  # no wall of it is that thin
    sheet = bake(Mesh(box.mesh().vertices, box.mesh().faces[:2], "sheet"), 32, cache=None, thickness=0.05).grid
    assert sheet.margin == pytest.approx(0.1 - 0.025)


@pytest.mark.parametrize("beyond", [1.0, -1.0])
def test_the_way_into_a_grid_is_the_shortest_there_is(beyond: float) -> None:
    ball = Sphere((0.1, 0.0, -0.1), 0.4)
    lattice = Lattice((-0.6, -0.6, -0.6), 0.05, (25,) * 3)
    values = ball.distance(torch.from_numpy(lattice.nodes_at(np.arange(25**3)))).reshape(25, 25, 25)
    grid = SdfGrid(beyond * values, torch.tensor(lattice.origin), 0.05, beyond)
    points = points_around(grid, 300, margin=3.0)
    low, high = torch.from_numpy(grid.bounds)
    place, error = grid.entered(points.reshape(30, 10, 3))
    place = place.reshape(-1, 3)
    inside = (points == points.clamp(low, high)).all(-1)
    assert torch.equal(place[inside], points[inside]) and (error == 0).all()
    length = (points - place).norm(dim=-1) + grid.distance(place).abs()
    assert (length <= ball.distance(points).abs() + 0.05 / 4 + 0.005).all()
    bad = torch.tensor([[float("nan"), 0.0, 0.0], [float("inf"), 0.0, 0.0]])
    assert not torch.isfinite(grid.entered(bad)[0]).all(-1).any()


def test_any_batch_shape_and_type() -> None:
    grid = random_grid()
    points = points_around(grid, 24, margin=0.2)
    whole = grid.distance(points)
    for shape in [(24,), (4, 6), (2, 3, 4), (1, 24, 1)]:
        torch.testing.assert_close(grid.distance(points.reshape(*shape, 3)), whole.reshape(shape))
    assert grid.distance(points[0]).shape == ()
    single = grid.distance(points.float())
    assert single.dtype == torch.float32
    torch.testing.assert_close(single, whole.float(), atol=1e-5, rtol=1e-5)
    empty = torch.zeros(0, 7, 3, requires_grad=True)
    grid.distance(empty).sum().backward()
    assert grid.distance(empty).shape == (0, 7)
    assert empty.grad is not None and empty.grad.shape == (0, 7, 3)


def test_batch_equals_loop_for_gradients() -> None:
    grid = random_grid()
    points = points_around(grid, 12, margin=0.2).reshape(3, 4, 3).requires_grad_()
    weights = torch.rand(3, 4, dtype=torch.float64)
    (whole,) = torch.autograd.grad((weights * grid.distance(points)).sum(), points)
    for i in range(3):
        one = points[i].detach().requires_grad_()
        (part,) = torch.autograd.grad((weights[i] * grid.distance(one)).sum(), one)
        torch.testing.assert_close(part, whole[i])


@pytest.mark.parametrize(("beyond", "margin"), AROUND)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_kernel_equals_torch_everywhere(beyond: float, margin: float, dtype: torch.dtype) -> None:
    grid = random_grid(beyond, margin)
    nodes = torch.from_numpy(grid.nodes(np.stack(np.meshgrid(*map(np.arange, SHAPE)), -1).reshape(-1, 3)))
    points = torch.cat([points_around(grid, 700, 0.4), nodes, torch.tensor([[1e9, 2.0, -1e15], [0, 1e-300, 5.2]])])
    points = points.to(dtype)
    value, gradient = grid.value_and_gradient(points)
    naive_value, naive_gradient = interpolate(points, grid.values, grid, with_gradient=True)
    assert naive_gradient is not None
    tolerance = {"atol": 1e-12, "rtol": 1e-12} if dtype == torch.float64 else {"atol": 2e-5, "rtol": 1e-5}
    torch.testing.assert_close(value, naive_value, **tolerance)
    outside = slice(0, 700)  # on nodes the gradient is that of either side
    torch.testing.assert_close(
        gradient[outside], naive_gradient[outside], **{**tolerance, "atol": tolerance["atol"] * 30}
    )
    torch.testing.assert_close(grid.distance(points), value, atol=0, rtol=0)


@pytest.mark.parametrize("row", [CROWDED, 2 * CROWDED, CROWDED - 1])
def test_long_rows_are_read_at_their_own_place(row: int) -> None:
    values = torch.rand(4, 5, row) - 0.5
    grid = SdfGrid(values, torch.tensor([0.3, -2.0, 1.0], dtype=torch.float64), 0.1)
    share = torch.rand(4000, 3, dtype=torch.float64)
    points = grid.origin + (1.4 * share - 0.2) * 0.1 * torch.tensor(values.shape)
    expected = interpolate(points, grid.values, grid, with_gradient=True)
    for ours, theirs in zip(grid.value_and_gradient(points), expected, strict=True):
        torch.testing.assert_close(ours, theirs, atol=1e-12, rtol=1e-12)
    torch.testing.assert_close(grid.values, values, atol=0, rtol=0)


def test_strided_points_and_any_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    grid = random_grid()
    points = points_around(grid, 1500, 0.3).float()
    value, gradient = grid.value_and_gradient(points)
    wide = torch.zeros(1500, 2, 3)
    wide[:, 1] = points
    assert torch.equal(grid.distance(wide[:, 1]), value)
    assert torch.equal(grid.distance(points.flip(0)).flip(0), value)
    monkeypatch.setattr(grids, "ENOUGH", 100)
    monkeypatch.setattr(torch, "get_num_threads", lambda: 7)
    again = grid.value_and_gradient(points)
    assert torch.equal(again[0], value) and torch.equal(again[1], gradient)


def test_the_second_derivative_is_refused() -> None:
    grid = random_grid()
    points = points_around(grid, 3).requires_grad_()
    (first,) = torch.autograd.grad(grid.distance(points).sum(), points, create_graph=True)
    with pytest.raises(RuntimeError, match="cannot be differentiated again"):
        first.sum().backward()


def test_products_with_the_gradient_lead_forward() -> None:
    """As Gauss-Newton asks for: a gradient, differentiated in what came in, is a directional derivative."""
    grid = random_grid()
    points = points_around(grid, 20).requires_grad_()
    dummy = torch.zeros(len(points), dtype=points.dtype, requires_grad=True)
    (pulled,) = torch.autograd.grad(grid.distance(points), points, dummy, create_graph=True)
    tangent = torch.randn_like(points)
    (forward,) = torch.autograd.grad(pulled, dummy, tangent)
    (gradient,) = torch.autograd.grad(grid.distance(points).sum(), points)
    torch.testing.assert_close(forward, (gradient * tangent).sum(-1))


def test_points_that_are_not_finite_do_not_crash() -> None:
    grid = random_grid()
    points = torch.tensor([[float("nan"), 0, 0], [float("inf"), 1.3, 5.1], [0, 1.3, 5.1]], requires_grad=True)
    value = grid.distance(points)
    value[2].backward()
    assert torch.isnan(value[0]) and not torch.isfinite(value[1]) and torch.isfinite(value[2])
    assert torch.isfinite(points.grad[2]).all()  # type: ignore[index]


def test_far_from_the_world_origin_nothing_is_lost() -> None:
    near = random_grid()
    shift = torch.tensor([5e5, 10.0, -4e6], dtype=torch.float64)
    far = SdfGrid(near.values, near.origin + shift, SPACING)
    points = points_around(near, 50, margin=0.2)
    torch.testing.assert_close(far.distance(points + shift), near.distance(points), atol=1e-7, rtol=0)
    single = (points + shift).float()  # already rounded: the question is whether the grid loses more
    torch.testing.assert_close(far.distance(single), far.distance(single.double()).float(), atol=1e-6, rtol=1e-6)


def test_nodes_and_bounds_say_where_the_values_are() -> None:
    grid = random_grid()
    index = np.array([[0, 0, 0], [4, 3, 5], [1, 2, 3]])
    assert np.allclose(grid.nodes(index)[:2], grid.bounds)
    values = grid.distance(torch.from_numpy(grid.nodes(index))).numpy()
    assert np.allclose(values, grid.values.numpy()[tuple(index.T)], atol=1e-7)


def test_save_and_load_return_the_same_grid(tmp_path: Path) -> None:
    grid = random_grid(beyond=-1.0, margin=0.3)
    grid.save(tmp_path / "a.npz")
    again = SdfGrid.load(tmp_path / "a.npz")
    assert torch.equal(again.values, grid.values) and torch.equal(again.origin, grid.origin)
    assert (again.spacing, again.beyond, again.margin) == (grid.spacing, grid.beyond, grid.margin)
    old = {name: array for name, array in grid.arrays().items() if name != "margin"}
    assert SdfGrid.from_arrays(old).margin == 0
    with pytest.raises(ValueError, match="margin"):
        SdfGrid.from_arrays({**old, "margin": np.array(-1.0)})
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_bad_files_and_values_are_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="does not exist"):
        SdfGrid.load(tmp_path / "none.npz")
    (tmp_path / "cut.npz").write_bytes(b"PK\x03\x04 half a file")
    with pytest.raises(UserError, match="bake again"):
        SdfGrid.load(tmp_path / "cut.npz")
    with (tmp_path / "pickle.npz").open("wb") as file:
        np.savez(file, values=np.array([{}], dtype=object), origin=np.zeros(3), spacing=1.0, beyond=1.0)
    with pytest.raises(UserError, match="bake again"):
        SdfGrid.load(tmp_path / "pickle.npz")
    with pytest.raises(UserError, match="spacing"):
        SdfGrid(torch.zeros(2, 2, 2), torch.zeros(3), 0.0)
    with pytest.raises(UserError, match="2 or more nodes"):
        SdfGrid(torch.zeros(2, 1, 2), torch.zeros(3), 1.0)
