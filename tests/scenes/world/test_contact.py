"""Nearest points, rays and clearances: analytic shapes, thin walls, and the promises about tolerance."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st
from torch import Tensor

from scenes.errors import UserError
from scenes.mesh.csg import csg
from scenes.mesh.mesh import Mesh, load_mesh
from scenes.mesh.primitives import Box, Plane, Sphere
from scenes.mesh.surface import Surface
from scenes.motion.waypoints import Waypoints
from scenes.sdf.bake import bake
from scenes.sdf.distances import FAR_ERROR
from scenes.sdf.field import DistanceField
from scenes.sdf.grid import SdfGrid
from scenes.sdf.lattice import Lattice
from scenes.world.contact import _check_vectors, capsule_clearance, closest_point, lipschitz, march, swept_clearance
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import Scene

BALL = Sphere((0.2, 0.1, -0.3), 0.5)
PLATE = Box((0.0, 0.0, 0.0), (2.0, 2.0, 0.02))  # 2 cm thick, across z


def baked(field: DistanceField, half: float = 1.0, resolution: int = 41) -> SdfGrid:
    """The field's values at the nodes of a cube around the origin."""
    lattice = Lattice((-half, -half, -half), 2 * half / (resolution - 1), (resolution,) * 3)
    index = torch.cartesian_prod(*(torch.arange(n, dtype=torch.float64) for n in lattice.shape))
    origin = torch.tensor(lattice.origin, dtype=torch.float64)
    values = field.distance(origin + lattice.spacing * index).reshape(lattice.shape)
    return SdfGrid(values.float(), origin, lattice.spacing)


def spread(n: int, size: float = 0.9, seed: int = 0) -> Tensor:
    noise = torch.Generator().manual_seed(seed)
    return size * (2 * torch.rand(n, 3, dtype=torch.float64, generator=noise) - 1)


def sampled(field: DistanceField, ends: tuple[Tensor, ...], steps: int = 200) -> Tensor:
    """Least value on a dense grid of shares: never below the true least."""
    s, t = torch.meshgrid(*(2 * [torch.linspace(0, 1, steps, dtype=torch.float64)]), indexing="ij")
    a0, b0, a1, b1 = (end[:, None, None] for end in ends)
    s, t = s[None, ..., None], t[None, ..., None]
    return field.distance((a0 * (1 - s) + b0 * s) * (1 - t) + (a1 * (1 - s) + b1 * s) * t).amin((1, 2))


def test_lipschitz_bounds_every_difference_and_is_found_in_scenes() -> None:
    noise = torch.Generator().manual_seed(1)
    rough = SdfGrid(torch.randn(5, 6, 7, generator=noise), torch.zeros(3), 0.3, beyond=-1.0)
    p, q = spread(4000, 3.0), spread(4000, 3.0, seed=1)
    near = p + 1e-3 * q
    for a, b in ((p, q), (p, near)):
        assert ((rough.distance(a) - rough.distance(b)).abs() <= rough.lipschitz * (a - b).norm(dim=-1)).all()
    assert rough.lipschitz < 40 and lipschitz(rough) == rough.lipschitz
    assert 1 <= baked(BALL).lipschitz <= math.sqrt(3) + 1e-3
    assert lipschitz(BALL) == 1.0 and lipschitz(Scene([], [BALL])) == 1.0


def test_closest_points_of_a_ball_are_exact_and_of_its_grid_nearly() -> None:
    points, centre = spread(200), torch.tensor(BALL.center, dtype=torch.float64)
    outward = torch.nn.functional.normalize(points - centre, dim=-1)
    found = closest_point(BALL, points)
    assert found.converged.all()
    torch.testing.assert_close(found.points, centre + 0.5 * outward, atol=1e-4, rtol=0)
    torch.testing.assert_close(found.normals, outward, atol=1e-4, rtol=0)
    grid = baked(BALL)
    found = closest_point(grid, points, tolerance=1e-5)
    assert found.converged.double().mean() > 0.98 and (grid.distance(found.points).abs() <= 1e-5)[found.converged].all()
    away = (points - centre).norm(dim=-1) > 0.2  # at the centre every direction is nearest
    torch.testing.assert_close(found.points[away], (centre + 0.5 * outward)[away], atol=0.02, rtol=0)


def test_between_two_walls_either_is_nearest() -> None:
    between = Box((0.0, 0.0, 0.0), (9.0, 9.0, 1.0))
    found = closest_point(baked(between, 0.6, 13), torch.zeros(1, 3, dtype=torch.float64))
    assert found.converged.all() and found.points[0, 2].abs() == pytest.approx(0.5, abs=0.01)
    found = closest_point(BALL, torch.tensor([BALL.center], dtype=torch.float64))
    assert found.converged.all() and BALL.distance(found.points).abs().max() <= 1e-4


def test_without_a_surface_nothing_converges() -> None:
    lattice = torch.full((8, 8, 8), 0.3)
    for beyond in (1.0, -1.0):
        grid = SdfGrid(lattice, torch.zeros(3), 0.1, beyond)
        found = closest_point(grid, spread(20, 2.0))
        assert not found.converged.any()
    assert closest_point(BALL, torch.zeros(0, 4, 3)).converged.shape == (0, 4)
    bad = torch.tensor([[math.nan, 0.0, 0.0], [math.inf, 0.0, 0.0], [1.0, 0.0, 0.0]], dtype=torch.float64)
    for field in (BALL, baked(BALL)):
        assert closest_point(field, bad).converged.tolist() == [False, False, True]


parts = st.builds(
    Box, st.tuples(*[st.floats(-0.5, 0.5)] * 3), st.tuples(*[st.floats(0.1, 0.8)] * 3), st.floats(0.0, 3.0)
)


@given(st.lists(parts, min_size=1, max_size=3), st.booleans(), st.integers(16, 48))
@settings(max_examples=20, deadline=None)
def test_what_converges_is_nearest_inside_and_outside_of_solids_and_grids(
    solids: list[Box], inward: bool, resolution: int
) -> None:
    mesh = csg("union", *solids)
    mesh = Mesh(mesh.vertices, mesh.faces[:, ::-1]) if inward else mesh
    grid, surface = bake(mesh, resolution, 0.15, cache=None).grid, Surface.of(mesh)
    low, high = torch.tensor(mesh.bounds)
    for margin in (0.0, 0.15, 2.0):
        points = low - margin + torch.rand(300, 3, dtype=torch.float64) * (high - low + 2 * margin)
        found = closest_point(grid, points)
        away, exact = (found.points - points).norm(dim=-1).numpy(), surface.unsigned_distance(points.numpy())
        converged, deep = found.converged.numpy(), exact > 3 * grid.spacing  # ridges are everywhere in thin solids
        excess = (away - exact)[converged]
        assert excess.max(initial=0) <= (1 + FAR_ERROR) * grid.spacing and (excess > grid.spacing).sum() <= 9
        assert (converged | ~deep).mean() > 0.8  # 0.86 is the least that was seen, at 16 nodes
        assert (grid.distance(found.points).abs() <= 1e-4)[found.converged].all()


@pytest.mark.parametrize("name", ["living_room", "office_large"])
def test_in_scans_nearly_all_points_find_their_nearest(shared: Path, name: str) -> None:
    mesh = load_mesh(shared / "data" / "meshes" / f"{name}.ply")
    grid, surface = bake(mesh, cache=None).grid, Surface.of(mesh)
    points = np.random.default_rng(1).uniform(mesh.bounds[0], mesh.bounds[1], (20_000, 3))
    points = points[grid.distance(torch.from_numpy(points)).numpy() > 0.02][:4000]
    found = closest_point(grid, torch.from_numpy(points))
    excess = np.linalg.norm(found.points.numpy() - points, axis=1) - surface.unsigned_distance(points)
    assert found.converged.double().mean() > 0.99
    assert excess[found.converged.numpy()].max() < grid.spacing


def test_the_nearest_of_several_fields_and_of_what_moves() -> None:
    way = Trajectory((0.0, 2.0), ((0.8, 0.0, 0.0), (0.8, 0.4, 0.0)), headings=(0.0, 1.0))
    thing = MovingObject(Box((0.0, 0.0, 0.0), (0.3, 0.5, 0.2)).mesh(), way, resolution=48, cache=None)
    solid = Box((-0.6, 0.0, 0.2), (0.4, 0.6, 0.5), 0.4)
    scene = Scene([solid.mesh()], [BALL], -0.7, objects=[thing], resolution=64, cache=None)
    points, time = spread(400, 2.0), torch.rand(400, dtype=torch.float64) * 2
    found = closest_point(scene, points, time)
    exact = scene.distance_exact(points.numpy(), time.numpy())
    excess = (found.points - points).norm(dim=-1).numpy() - np.abs(exact)
    assert excess[found.converged.numpy()].max() < 0.02
    assert found.converged.double().mean() > 0.97
    again = closest_point(scene, points.reshape(4, 100, 3), time.reshape(4, 100))
    torch.testing.assert_close(again.points.reshape(-1, 3), found.points, atol=0, rtol=0)
    outward = found.points + 0.02 * found.normals
    clear = found.converged & (scene.distance(outward, time) > 0)
    assert clear.double().sum() > 0.9 * found.converged.double().sum()


def test_within_two_solids_at_once_nothing_false_converges() -> None:
    a, b = Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), Box((0.4, 0.0, 0.0), (1.0, 0.9, 0.9))
    scene, whole = Scene([], [a, b], -5.0), Surface.of(csg("union", a, b))
    points = spread(500, 0.8)
    found = closest_point(scene, points)
    away, exact = (found.points - points).norm(dim=-1).numpy(), whole.unsigned_distance(points.numpy())
    wrong = np.abs(away - exact) > 1e-3
    assert wrong.any() and not found.converged.numpy()[wrong].any()
    assert found.converged[scene.distance(points) > 0].all()


def test_moving_grids_are_as_steep_as_their_own() -> None:
    still = Trajectory((0.0,), ((1.0, 0.0, 0.0),))
    thing = MovingObject(Sphere((0, 0, 0), 0.3).mesh(), still, resolution=24, cache=None)
    assert thing.bake is not None
    assert lipschitz(thing) == lipschitz(thing.bake.grid) > 1
    assert lipschitz(Scene(objects=[thing])) == lipschitz(thing)
    assert lipschitz(MovingObject(Sphere((0, 0, 0), 0.3), still)) == 1


def test_rays_meet_balls_where_they_should() -> None:
    origins, centre = spread(300, 2.0), torch.tensor(BALL.center, dtype=torch.float64)
    ways = centre - origins + spread(300, seed=3)
    unit = torch.nn.functional.normalize(ways, dim=-1)
    middle = ((centre - origins) * unit).sum(-1)
    square = 0.25 - (centre - origins).square().sum(-1) + middle.square()
    expected = middle - square.clamp_min(0).sqrt()
    inside = (origins - centre).norm(dim=-1) < 0.5
    found = march(BALL, origins, ways, 10.0)
    assert (found[inside] == 0).all()
    clear = (square.abs() > 0.02) & ~inside  # rays that graze arrive where they come near enough
    hits = clear & (square > 0) & (middle > 0)
    assert 10 < int(hits.sum()) < 290
    torch.testing.assert_close(found[hits], expected[hits], atol=2e-3, rtol=0)
    assert torch.isinf(found[clear & ~hits]).all()
    assert torch.isinf(march(BALL, origins, ways, 1e-3)[~inside]).all()


def test_rays_never_pass_a_thin_plate() -> None:
    origins = spread(500, 0.4) * torch.tensor([1.0, 1.0, 0.0]) + torch.tensor([0.0, 0.0, 0.4])
    ways = spread(500, seed=4) * torch.tensor([0.1, 0.1, 0.0]) - torch.tensor([0.0, 0.0, 1.0])
    unit = torch.nn.functional.normalize(ways, dim=-1)
    inner = (origins + 0.4 * ways)[:, :2].abs().amax(-1) < 0.5
    # The spacing is 1 cm: the plate holds one node, and the interpolant's slopes reach beyond 1.
    for field in (PLATE, baked(PLATE, 0.5, 101)):
        gone = march(field, origins, ways, 5.0)
        torch.testing.assert_close(
            (gone * unit[:, 2])[inner], torch.full((int(inner.sum()),), -0.39).double(), atol=5e-4, rtol=0
        )
    assert march(PLATE, origins[:0], ways[:0], 1.0).shape == (0,)


@pytest.mark.parametrize("field", [BALL, Box((0.1, 0.0, 0.2), (0.5, 0.7, 0.3), 0.4), baked(BALL)])
@pytest.mark.parametrize("tolerance", [0.05, 3e-3])
def test_swept_clearance_keeps_its_tolerance(field: DistanceField, tolerance: float) -> None:
    ends = tuple(spread(40, seed=s) for s in range(4))
    found = swept_clearance(field, *ends, radius=0.1, tolerance=tolerance) + 0.1
    dense = sampled(field, ends)
    assert (found <= dense + tolerance).all()
    assert (found >= dense - 0.02).all()  # values of the field itself: only the dense grid's own error
    torch.testing.assert_close(
        capsule_clearance(field, ends[0], ends[1], 0.1, tolerance=tolerance),
        swept_clearance(field, ends[0], ends[1], ends[0], ends[1], 0.1, tolerance=tolerance),
    )


@pytest.mark.parametrize(("beyond", "free"), [(1.0, False), (-1.0, False), (1.0, True)])
def test_the_least_of_a_rough_grid_is_never_missed(beyond: float, free: bool) -> None:
    """Noise whose strength differs from place to place: what is known of one block says nothing of the next but one."""
    noise = torch.Generator().manual_seed(2)
    strength = torch.rand(6, 6, 6, generator=noise).pow(4).repeat_interleave(4, 0).repeat_interleave(4, 1)
    values = torch.randn(24, 24, 24, generator=noise) * strength.repeat_interleave(4, 2)
    margin = 0.0
    for side in (values[0], values[-1], values[:, 0], values[:, -1], values[..., 0], values[..., -1]) if free else ():
        side.abs_().add_(0.5)
        margin = 0.4
    grid = SdfGrid(values, torch.full((3,), -1.0), 2 / 23, beyond, margin)
    assert (grid.outer_margin > 0.2) == (free and beyond > 0)
    ends = tuple(spread(60, 1.3, seed=s) for s in range(4))
    ends = (ends[0], ends[0] + 0.5 * ends[1], ends[0] + 0.3 * ends[2], ends[0] + 0.3 * ends[3])
    found = swept_clearance(grid, *ends, radius=0.0, tolerance=0.01)
    assert (found <= sampled(grid, ends) + 0.01).all()
    value, slope = grid.value_and_gradient(torch.cat(ends))
    assert (slope.norm(dim=-1) <= grid.lipschitz).all() and torch.isfinite(value).all()


@pytest.mark.parametrize("node", [20, 21, 22])
def test_one_low_node_in_a_flat_grid_is_found_from_any_distance(node: int) -> None:
    values = torch.ones(40, 40, 40)
    values[node, node, node] = -1.0
    grid = SdfGrid(values, torch.full((3,), -0.1 * node), 0.1)
    for reach in (0.15, 0.3, 0.45, 0.7, 1.0, 1.7):
        for middle in torch.linspace(-0.9, 0.9, 19).double() * reach:
            a = torch.tensor([float(middle) - reach, 0.0, 0.0], dtype=torch.float64)
            b = torch.tensor([float(middle) + reach, 0.0, 0.0], dtype=torch.float64)
            assert float(capsule_clearance(grid, a, b, 0.0, tolerance=0.01)) == pytest.approx(-1, abs=0.011)


def test_a_plane_is_met_by_the_end_that_is_lowest() -> None:
    ends = torch.ones(4, 4, 3, dtype=torch.float64)  # of capsule i, end i is low
    ends[range(4), range(4), 1] = 0.2
    room = swept_clearance(Plane((0.0, 0.0, 0.0)), *ends.unbind(1), radius=0.1)
    torch.testing.assert_close(room, torch.full((4,), 0.1, dtype=torch.float64))


def test_the_least_of_several_fields_is_found_in_any() -> None:
    scene = Scene([], [BALL, Box((0.0, -0.6, 0.5), (0.4, 0.4, 0.4))], floor=-0.8)
    ends = tuple(spread(40, seed=s) for s in range(4))
    dense = sampled(scene, ends)
    found = swept_clearance(scene, *ends, radius=0.0, tolerance=0.01)
    assert (found <= dense + 0.01).all() and (found >= dense - 0.03).all()


def test_clearances_of_analytic_shapes() -> None:
    # A capsule of radius 0.1 upright beside the ball, its axis 0.8 m from the centre; and across the box's edge.
    a, b = torch.tensor([[1.0, -3.0, -0.3], [1.0, 4.0, -0.3]], dtype=torch.float64)
    room = capsule_clearance(BALL, a, b, 0.1, tolerance=1e-5)
    assert float(room) == pytest.approx(0.8 - 0.5 - 0.1, abs=2e-5)
    box = Box((0.0, 0.0, 0.0), (2.0, 2.0, 2.0))
    a, b = torch.tensor([[0.0, 3.0, 0.0], [3.0, 0.0, 0.0]], dtype=torch.float64)  # passes (1.5, 1.5, 0)
    room = capsule_clearance(box, a, b, 0.2, tolerance=1e-5)
    assert float(room) == pytest.approx(math.sqrt(0.5) - 0.2, abs=2e-5)


@pytest.mark.parametrize("field", [PLATE, baked(PLATE, 0.5, 101)])
def test_a_fast_hand_cannot_jump_through_a_thin_plate(field: DistanceField) -> None:
    a0, b0 = torch.tensor([[0.0, 0.0, 0.3], [0.1, 0.1, 0.25]], dtype=torch.float64)
    a1, b1 = a0 - torch.tensor([0.0, 0.0, 0.5]), b0 - torch.tensor([0.0, 0.0, 0.5])
    frames = torch.stack([capsule_clearance(field, a0, b0, 0.04), capsule_clearance(field, a1, b1, 0.04)])
    assert (frames > 0.1).all()
    swept = float(swept_clearance(field, a0, b0, a1, b1, 0.04))
    assert swept == pytest.approx(-0.05, abs=2e-3)


@pytest.mark.parametrize("field", [BALL, baked(BALL)])
def test_gradients_with_respect_to_all_ends_and_the_radius(field: DistanceField) -> None:
    ends = [spread(2, seed=s).requires_grad_() for s in range(4)]
    radius = torch.full((2,), 0.1, dtype=torch.float64, requires_grad=True)

    def room(*given: Tensor) -> Tensor:
        return swept_clearance(field, *given, tolerance=0.01)  # type: ignore[arg-type,misc]

    assert torch.autograd.gradcheck(room, (*ends, radius), eps=1e-7, atol=1e-5)


def test_the_gradient_of_a_sharp_minimum_is_that_of_the_minimum() -> None:
    """Envelope theorem: beside the ball, moving the capsule away by 1 mm gains 1 mm, and along its axis nothing."""
    a, b = torch.tensor([[1.0, -0.4, -0.3], [1.0, 0.7, -0.3]], dtype=torch.float64)
    shift = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    room = capsule_clearance(BALL, a + shift, b + shift, 0.1, tolerance=1e-7)
    (slope,) = torch.autograd.grad(room, shift)
    torch.testing.assert_close(slope, torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64), atol=1e-3, rtol=0)


def test_batch_equals_loop_in_any_shape() -> None:
    ends = [spread(12, seed=s).reshape(3, 4, 3) for s in range(4)]
    radius = torch.linspace(0.01, 0.2, 4, dtype=torch.float64)
    grid = baked(BALL)
    whole = swept_clearance(grid, *ends, radius=radius, tolerance=0.02)
    assert whole.shape == (3, 4)
    for i in range(3):
        for j in range(4):
            alone = swept_clearance(grid, *(end[i, j] for end in ends), radius=radius[j], tolerance=0.02)
            torch.testing.assert_close(alone, whole[i, j])
            ray = march(grid, ends[0][i, j], ends[1][i, j], 3.0)
            torch.testing.assert_close(ray, march(grid, ends[0], ends[1], 3.0)[i, j])
    assert swept_clearance(grid, *(end[:0] for end in ends), radius=0.1).shape == (0, 4)


def test_enough_room_is_not_measured_but_never_understated() -> None:
    ends = [spread(200, 1.5, seed=s) for s in range(4)]
    exact = swept_clearance(BALL, *ends, radius=0.05, tolerance=0.01)
    asked: list[int] = []

    class Counting:
        def distance(self, points: Tensor, time: Tensor | None = None) -> Tensor:
            asked.append(points[..., 0].numel())
            return BALL.distance(points, time)

    quick = swept_clearance(Counting(), *ends, radius=0.05, tolerance=0.01, enough=0.0)
    few = sum(asked)
    asked.clear()
    swept_clearance(Counting(), *ends, radius=0.05, tolerance=0.01)
    assert few < 0.7 * sum(asked)
    hits = exact <= 0
    assert 10 < int(hits.sum()) < 190
    torch.testing.assert_close(quick[hits], exact[hits], atol=0.01, rtol=0)
    assert (quick[~hits] > 0).all()


def test_what_moves_meanwhile_is_met_where_it_is() -> None:
    """A ball flies through a capsule that stands still, and is far from it at both moments."""
    ball = Sphere((0.0, 0.0, 0.0), 0.1, Waypoints((0.0, 1.0), ((-3.0, 0.0, 0.0), (3.0, 0.0, 0.0))))
    a, b = torch.tensor([[0.5, -0.5, 0.0], [0.5, 0.5, 0.0]], dtype=torch.float64)
    zero, one = torch.tensor(0.0), torch.tensor(1.0)
    assert min(float(capsule_clearance(ball, a, b, 0.1, time=when)) for when in (zero, one)) > 2
    room = swept_clearance(ball, a, b, a, b, 0.1, times=(zero, one), speed=6.0)
    assert float(room) == pytest.approx(-0.2, abs=2e-3)


def test_what_is_not_finite_ends_and_shows() -> None:
    for bad in (math.nan, math.inf):
        a = torch.tensor([[bad, 0.0, 0.0], [0.0, 2.0, 0.0]], dtype=torch.float64)
        b = torch.tensor([[1.0, 0.0, 0.0], [0.1, 2.0, 0.0]], dtype=torch.float64)
        for field in (Plane((0.0, 0.0, 0.0)), baked(BALL)):
            room = capsule_clearance(field, a, b, 0.1)
            assert torch.isfinite(room[1])
            march(field, a, b, 3.0)
    far = torch.tensor([1e12, 0.0, 1e12], dtype=torch.float64)
    assert torch.isfinite(capsule_clearance(baked(BALL), -far, far, 0.1))


def test_errors_say_what_to_give() -> None:
    p = torch.zeros(2, 3)
    with pytest.raises(UserError, match=r"b has shape \(1, 3\)"):
        _check_vectors(a=p, b=p[:1])  # what the tests' own shape checker would stop before it got here
    with pytest.raises(UserError, match="tolerance is 0"):
        capsule_clearance(BALL, p, p, 0.1, tolerance=0)
    with pytest.raises(UserError, match="point somewhere"):
        march(BALL, p, p, 1.0)
    with pytest.raises(UserError, match="farthest is inf"):
        march(BALL, p, p + 1, math.inf)
    with pytest.raises(UserError, match="steps"):
        closest_point(BALL, p, steps=0)
