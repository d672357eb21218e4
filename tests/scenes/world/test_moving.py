"""Objects that move: rotations against closed forms, and every moment against the same thing at rest there."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation, Slerp

from scenes.errors import UserError
from scenes.mesh.csg import csg
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Box, Plane, Primitive, Sphere
from scenes.motion.waypoints import Waypoints
from scenes.sdf.bake import bake
from scenes.sdf.field import DistanceField
from scenes.sdf.grid import SdfGrid
from scenes.world.moving import PADDING, MovingObject, Trajectory
from scenes.world.scene import Scene

WAY = Trajectory((0.5, 1.5, 4.0), ((0, 0, 0), (1, 0.2, -0.5), (2, 0, 1)), headings=(0.0, 1.3, -0.4))
STAND = Trajectory((0.0,), ((0.3, 0.1, -0.2),), headings=(0.7,))


def l_shape() -> Mesh:
    """A solid without any symmetry."""
    mesh = csg("union", Box((0, 0.2, 0), (0.8, 0.4, 0.3)), Box((0.25, 0.5, 0.1), (0.3, 0.7, 0.5)))
    return Mesh(mesh.vertices, mesh.faces, "ell")


def ell(trajectory: Trajectory = WAY, resolution: int = 48) -> MovingObject:
    return MovingObject(l_shape(), trajectory, resolution=resolution, cache=None)


def points(n: int = 200, seed: int = 0) -> torch.Tensor:
    return 3 * torch.rand(n, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(seed)) - 1.0


def around(mesh: Mesh, n: int = 400) -> torch.Tensor:
    """Points within 0.2 m of a mesh's bounds."""
    low, high = torch.from_numpy(mesh.bounds)
    share = torch.rand(n, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    return low - 0.2 + share * (high - low + 0.4)


def moments(n: int = 200) -> torch.Tensor:
    return torch.linspace(-0.5, 4.5, n, dtype=torch.float64)


def random_quaternions(k: int, seed: int = 0) -> np.ndarray:
    q = np.random.default_rng(seed).normal(size=(k, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)  # half of the neighbours lie more than a half turn apart


# ------------------------------------------------------------------------------------------------------ trajectories


def test_headings_are_turned_evenly_the_shorter_way() -> None:
    times = torch.linspace(-1, 2, 31, dtype=torch.float64)
    for first, last, step in ((3.0, -3.0, 2 * math.pi - 6.0), (-1.0, -0.5, 0.5)):  # 0.28 rad on, not 6 back
        _, rotation = Trajectory((0.0, 1.0), ((0, 0, 0),) * 2, headings=(first, last)).at(times)
        forward = rotation @ torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
        heading = first + step * times.clamp(0, 1)
        torch.testing.assert_close(forward, torch.stack([heading.sin(), 0 * heading, heading.cos()], dim=-1))


@pytest.mark.parametrize("half", [math.pi, 3.1416, 3.142, -math.pi, -3.1416])
def test_half_turns_go_the_way_they_were_stated(half: float) -> None:
    for start in np.arange(-40, 41) / 10:
        headings = [float(start + k * half) for k in range(3)]
        _, rotation = Trajectory((0, 1, 2), ((0, 0, 0),) * 3, headings).at(torch.arange(0, 2.1, 0.25).double())
        expected = start + half * np.arange(0, 2.1, 0.25)
        assert np.abs(rotation[:, 0, 2].numpy() - np.sin(expected)).max() < 1e-9


def test_quaternions_are_slerped() -> None:
    knots = np.array([0.0, 0.4, 1.0, 2.5, 3.0])
    q = random_quaternions(5)
    dots = (q[1:] * q[:-1]).sum(axis=1)
    assert (dots < 0).any() and (dots > 0).any()
    way = Trajectory(knots.tolist(), np.zeros((5, 3)).tolist(), quaternions=q.tolist())
    times = np.linspace(-1, 4, 101)
    _, rotation = way.at(torch.from_numpy(times))
    expected = Slerp(knots, Rotation.from_quat(q[:, [1, 2, 3, 0]]))(times.clip(0, 3)).as_matrix()
    assert np.abs(rotation.numpy() - expected).max() < 1e-12
    identity = torch.eye(3, dtype=torch.float64).expand(101, 3, 3)
    torch.testing.assert_close(rotation @ rotation.transpose(-1, -2), identity)


def test_slerp_is_the_two_point_formula() -> None:
    (a, b), u = random_quaternions(2, seed=3), 0.3
    b = b if a @ b > 0 else -b
    angle = math.acos(a @ b)
    c = (math.sin((1 - u) * angle) * a + math.sin(u * angle) * b) / math.sin(angle)
    for way in (
        Trajectory((0.0, 1.0), ((0, 0, 0),) * 2, quaternions=(a.tolist(), (-b).tolist())),  # the same rotation
        Trajectory((0.0, 1.0), ((0, 0, 0),) * 2, quaternions=(a.tolist(), b.tolist())),
    ):
        _, rotation = way.at(torch.tensor(u, dtype=torch.float64))
        assert np.abs(rotation.numpy() - Rotation.from_quat(c[[1, 2, 3, 0]]).as_matrix()).max() < 1e-12


def test_headings_are_quaternions_about_y() -> None:
    assert WAY.headings is not None
    q = [(math.cos(h / 2), 0.0, math.sin(h / 2), 0.0) for h in WAY.headings]
    same = Trajectory(WAY.times, WAY.positions, quaternions=q)
    for mine, other in zip(WAY.at(moments()), same.at(moments()), strict=True):
        torch.testing.assert_close(mine, other)


def test_positions_are_those_of_waypoints_and_time_has_a_gradient() -> None:
    position, _ = WAY.at(moments())
    torch.testing.assert_close(position, Waypoints(WAY.times, WAY.positions).at(moments()))
    inner = torch.tensor([0.7, 1.2, 2.0, 3.9], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(WAY.at, (inner,))
    upside = Trajectory((0.0, 2.0), ((0, 0, 0),) * 2, quaternions=random_quaternions(2).tolist())
    assert torch.autograd.gradcheck(upside.at, (torch.tensor([0.1, 1.0], dtype=torch.float64, requires_grad=True),))


# ----------------------------------------------------------------------------------------------------------- objects


def test_standing_still_is_a_static_scene() -> None:
    here = STAND.at(torch.zeros((), dtype=torch.float64))
    posed = Mesh(l_shape().vertices @ here[1].numpy().T + here[0].numpy(), l_shape().faces)
    moving = Scene(objects=[ell(STAND, 96)], floor=-5.0)
    static = Scene([posed], floor=-5.0, resolution=128, cache=None)
    p, t = around(posed), moments(400)
    exact = moving.distance_exact(p.numpy(), t.numpy())
    assert np.abs(exact - static.distance_exact(p.numpy())).max() < 1e-12
    near = np.abs(exact) < 0.1  # beyond the static scene's padding its grid holds a bound only
    gap = (moving.distance(p, t) - static.distance(p)).abs().numpy()
    assert near.sum() > 50 and gap[near].max() < 0.02
    origin = Trajectory((0.0, 1.0), ((0, 0, 0),) * 2)
    grid = ell(origin).field
    torch.testing.assert_close(ell(origin).distance(points(), moments()), grid.distance(points()), rtol=0, atol=1e-15)


@pytest.mark.parametrize("time", [-1.0, 0.5, 1.1, 1.5, 3.3, 9.0])
def test_at_a_moment_it_is_the_mesh_moved_there(time: float) -> None:
    thing = ell()
    scene, posed = Scene(objects=[thing], floor=-5.0), Scene([thing.mesh(time)], floor=-5.0, resolution=64, cache=None)
    p = around(thing.mesh(time))
    exact = scene.distance_exact(p.numpy(), time)
    assert np.abs(exact - posed.distance_exact(p.numpy())).max() < 1e-12
    near = np.abs(exact) < PADDING
    gap = np.abs(scene.distance(p, torch.tensor(time)).numpy() - exact)
    assert near.sum() > 200 and gap[near].max() < np.sqrt(3) / 2 * 0.03


def test_the_exact_distance_asks_each_point_at_its_own_time() -> None:
    thing, p, t = ell(), points(60).numpy(), moments(60).numpy()
    whole = thing.distance_exact(p, t)
    assert whole.tolist() == [float(thing.distance_exact(p[i : i + 1], float(t[i]))[0]) for i in range(60)]
    assert np.allclose(thing.distance_exact(p), thing.distance_exact(p, 0.0))


def test_what_is_beyond_the_grid_is_a_bound_from_below_and_more_than_the_padding() -> None:
    thing, p = ell(), 4 * points() - 2
    found, exact = thing.distance(p, moments()).numpy(), thing.distance_exact(p.numpy(), moments().numpy())
    assert (found - exact).max() < 1e-3 and (exact > 2 * PADDING).sum() > 100
    assert found[exact > 2 * PADDING].min() > PADDING


def test_batches_broadcast_over_time_and_equal_loops() -> None:
    thing, p = ell(), points(2 * 5 * 7).reshape(2, 5, 7, 3)
    times = torch.linspace(0, 4, 5, dtype=torch.float64)
    whole = thing.distance(p, times[:, None])
    assert whole.shape == (2, 5, 7)
    for sample in range(2):
        for frame in range(5):
            torch.testing.assert_close(whole[sample, frame], thing.distance(p[sample, frame], times[frame]))
    torch.testing.assert_close(thing.distance(p), thing.distance(p, torch.tensor(0)))  # no time means 0 s
    single = thing.distance(p.float(), times[:, None].float())
    assert single.dtype == torch.float32
    torch.testing.assert_close(single, whole.float(), atol=1e-5, rtol=0)


@pytest.mark.parametrize("shape", [l_shape(), Box((0.1, 0, 0), (0.5, 0.6, 0.7), yaw=0.2)], ids=["mesh", "box"])
def test_gradients_come_back_into_the_world(shape: Mesh | Primitive) -> None:
    thing = MovingObject(shape, WAY, resolution=32, cache=None)
    p, t = points(40).requires_grad_(), torch.linspace(0.6, 3.9, 40, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(thing.distance, (p, t), eps=1e-7, atol=1e-5)
    assert isinstance(thing, DistanceField)


def test_a_primitive_on_a_trajectory_is_exact() -> None:
    box = MovingObject(Box((0.0, 0.5, 0.2), (0.4, 1.0, 0.2)), WAY)
    p, t = points(), moments()
    assert WAY.headings is not None
    yaw = np.interp(t, WAY.times, WAY.headings).reshape(-1)
    centre = Rotation.from_rotvec(yaw[:, None] * [0, 1, 0]).apply([0.0, 0.5, 0.2])
    centre += Waypoints(WAY.times, WAY.positions).at(t).numpy()
    expected = [
        float(Box(tuple(c), (0.4, 1.0, 0.2), float(a)).distance(q)) for c, a, q in zip(centre, yaw, p, strict=True)
    ]
    assert box.distance(p, t).tolist() == pytest.approx(expected, abs=1e-12)
    assert box.distance_exact(p.numpy(), t.numpy()) == pytest.approx(expected, abs=1e-12)
    assert box.name == "box" and box.bake is None


def test_a_grid_that_was_baked_before_serves_as_well(tmp_path: Path) -> None:
    made = bake(l_shape(), 48, PADDING, "outside", cache=None)
    made.grid.save(tmp_path / "grid.npz")
    from_bake, from_file = MovingObject(made, WAY), MovingObject(SdfGrid.load(tmp_path / "grid.npz"), WAY, "ell")
    for thing in (from_bake, from_file):
        torch.testing.assert_close(thing.distance(points(), moments()), ell().distance(points(), moments()))
        # its surface is where its interpolant is 0: within half a voxel of the triangles, corners rounded
        gap = thing.distance_exact(points().numpy(), moments().numpy())
        gap -= ell().distance_exact(points().numpy(), moments().numpy())
        assert np.abs(gap).max() < made.grid.spacing
    assert from_bake.digest == from_file.digest
    a, b, c = np.moveaxis(from_file.solid.triangles, 1, 0)
    assert float((a * np.cross(b, c)).sum()) > 0  # facing outward, as pictures want it


def test_scenes_hold_objects() -> None:
    wall = Box((0, 1, -3), (4, 2, 0.2))
    scene = Scene([wall.mesh()], [Sphere((5, 1, 0), 0.2)], objects=[ell()], resolution=16, cache=None)
    p, t = points(), moments()
    least = torch.stack([field.distance(p, t) for field in scene.fields]).amin(dim=0)
    torch.testing.assert_close(scene.distance(p, t), least)
    assert len(scene.fields) == 3 and "ell" in scene.report()[1] and "objects=1" in repr(scene)
    # the floor is the wall's top or foot, whatever passes by; without meshes it is at 0
    assert scene.floor == Scene([wall.mesh()]).floor
    assert Scene(objects=[ell()]).floor.height == 0.0
    times = np.linspace(-1, 5, 300)
    boxes = np.stack([scene.objects[0].mesh(float(time)).bounds for time in times])
    low, high = scene.objects[0].bounds
    assert np.allclose(low, boxes[:, 0].min(axis=0), atol=5e-3) and np.allclose(
        high, boxes[:, 1].max(axis=0), atol=5e-3
    )
    assert (scene.bounds[0] <= low).all() and (scene.bounds[1] >= high).all()


def test_bounds_follow_a_turn_that_ends_where_it_began() -> None:
    door = Box((0.5, 1.0, 0.0), (1.0, 2.0, 0.1))
    swing = Trajectory((0.0, 1.0), ((0, 0, 0),) * 2, headings=(0.0, math.pi))
    low, high = MovingObject(door, swing).bounds
    assert low.tolist() == pytest.approx([-1.0, 0.0, -1.0], abs=0.01)  # +pi/2 turns its +x to -z
    assert high.tolist() == pytest.approx([1.0, 2.0, 0.05], abs=0.01)


def test_bakes_of_objects_are_cached_whatever_their_way(tmp_path: Path) -> None:
    for way in (WAY, STAND):
        MovingObject(l_shape(), way, resolution=16, cache=tmp_path).distance(points())
    assert len(list(tmp_path.glob("*.npz"))) == 1


def test_the_digest_knows_everything_distances_depend_on() -> None:
    def variants() -> list[Scene]:
        other = Trajectory(WAY.times, WAY.positions, headings=(0.0, 1.3, -0.5))
        things = [ell(), ell(other), ell(WAY, 32), MovingObject(Box((0, 0, 0), (1, 1, 1)), WAY)]
        return [Scene(), *(Scene(objects=[thing]) for thing in things), Scene(objects=things[:2])]

    digests = [scene.digest for scene in variants()]
    assert len(set(digests)) == len(digests) and digests == [scene.digest for scene in variants()]


def test_describing_an_object_bakes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("baked")

    monkeypatch.setattr("scenes.world.moving.bake", refuse)
    scene = Scene(objects=[ell()])
    assert scene.bounds.shape == (2, 3) and len(scene.digest) == 64
    assert np.isfinite(scene.distance_exact(np.zeros((1, 3)), 0.0)).all()
    with pytest.raises(AssertionError, match="baked"):
        scene.report()


ORIGIN = ((0, 0, 0), (0, 0, 0))
ROOM = SdfGrid(torch.ones(2, 2, 2), torch.zeros(3), 1.0, beyond=-1.0)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Trajectory((0.0, 0.0), ORIGIN), "later than the one before"),
        (lambda: Trajectory((0.0,), ORIGIN), "1 times and 2 positions"),
        (lambda: Trajectory((0.0, 1.0), ORIGIN, headings=(0.0,)), r"headings have shape \[1\] for 2 times"),
        (lambda: Trajectory((0.0, 1.0), ORIGIN, headings=(0.0, math.nan)), "finite"),
        (lambda: Trajectory((0.0, 1.0), ORIGIN, quaternions=((1, 0, 0, 0),)), "four numbers w, x, y, z"),
        (lambda: Trajectory((0.0, 1.0), ORIGIN, quaternions=((1, 0, 0), (1, 0, 0))), r"shape \[2, 3\]"),
        (lambda: Trajectory((0.0, 1.0), ORIGIN, quaternions=((1, 0, 0, 0), (1, 0, 1, 0))), "quaternion 1 has length"),
        (lambda: Trajectory((0.0,), ORIGIN[:1], headings=(0,), quaternions=((1, 0, 0, 0),)), "keep one"),
        (lambda: MovingObject(Plane((0, 0, 0)), STAND), "plane"),
        (lambda: MovingObject(Sphere((0, 0, 0), 1, Waypoints((0.0,), ((0, 0, 0),))), STAND), "keep one"),
        (lambda: MovingObject(ROOM, STAND), "room"),
        (lambda: MovingObject(l_shape(), STAND, resolution=4), "resolution is 4"),
        (lambda: MovingObject(SdfGrid(ROOM.values, ROOM.origin, 1.0), STAND).solid, "nowhere 0"),
    ],
)
def test_bad_values_are_one_sentence(build: Callable[[], object], message: str) -> None:
    with pytest.raises(UserError, match=message) as caught:
        build()
    assert "\n" not in str(caught.value)
