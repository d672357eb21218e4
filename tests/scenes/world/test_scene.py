"""Scenes: one field out of many, the oracle beside it, and no cost before it is needed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import scenes.world.scene as module
from scenes.errors import UserError
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Box, Capsule, Cylinder, Plane, Sphere
from scenes.motion.frames import HOME, Place
from scenes.motion.waypoints import Waypoints
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import Scene, bundled, bundled_names, load_scene

ROOM, TABLE = Box((0.0, 1.25, 0.0), (4.0, 2.5, 3.0)), Box((1.0, 0.7, 0.0), (0.8, 0.4, 1.1))
BALL = Sphere((0, 1, 0), 0.2, Waypoints((0.0, 2.0), ((-1, 1, 0.8), (0, 1, 0.8))))


def walls() -> Mesh:
    mesh = ROOM.mesh()
    return Mesh(mesh.vertices, mesh.faces[:, ::-1], "walls")


def points(n: int = 300) -> torch.Tensor:
    return (torch.rand(n, 3, dtype=torch.float64) - 0.5) * torch.tensor([5.0, 4.0, 4.0]) + torch.tensor([0, 1.2, 0])


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene([walls(), TABLE.mesh()], [BALL, Capsule((-1, 0, -1), (-1, 1, -1), 0.3)], resolution=32, cache=None)


def test_distance_is_the_least_of_all_fields(scene: Scene) -> None:
    p, time = points(), torch.rand(300, dtype=torch.float64)
    least = torch.stack([field.distance(p, time) for field in scene.fields]).amin(dim=0)
    torch.testing.assert_close(scene.distance(p, time), least)
    assert len(scene.fields) == 4 and len(scene.report()) == 2


def test_the_exact_distance_is_that_of_the_solids_and_the_grid_is_near_it(scene: Scene) -> None:
    p, time = points(), torch.rand(300, dtype=torch.float64) * 2
    capsule = scene.primitives[1]
    parts = [-ROOM.distance(p), TABLE.distance(p), BALL.distance(p, time), capsule.distance(p)]
    expected = torch.stack(parts).amin(dim=0).numpy()
    exact = scene.distance_exact(p.numpy(), time.numpy())
    assert np.abs(exact - expected).max() < 1e-9
    inside = ((p - torch.tensor(ROOM.center)).abs() < torch.tensor(ROOM.size) / 2).all(dim=-1).numpy()
    gap = np.abs(scene.distance(p, time).numpy() - exact)[inside]
    assert gap.max() < np.sqrt(3) / 2 * scene.bakes[0].grid.spacing


def test_time_moves_what_moves_and_gradients_flow(scene: Scene) -> None:
    p = torch.tensor([[-0.5, 1.0, 0.8]], dtype=torch.float64, requires_grad=True)
    near, far = scene.distance(p, torch.tensor([1.0])), scene.distance(p, torch.tensor([0.0]))
    assert near.item() == pytest.approx(-0.2) and far.item() == pytest.approx(0.3)
    assert scene.distance(p).item() == pytest.approx(0.3)  # no time means 0 s
    assert scene.distance_exact(p.detach().numpy(), 1.0)[0] == pytest.approx(-0.2)
    (gradient,) = torch.autograd.grad(far.sum(), p)
    assert gradient[0].tolist() == pytest.approx([1.0, 0.0, 0.0])


def test_batches_of_motions_with_times(scene: Scene) -> None:
    p = points(2 * 5 * 7).reshape(2, 5, 7, 3)
    times = torch.linspace(0, 2, 5, dtype=torch.float64)
    whole = scene.distance(p, times[:, None])
    assert whole.shape == (2, 5, 7)
    torch.testing.assert_close(whole[1, 3], scene.distance(p[1, 3], times[3]))
    assert scene.distance(p.float(), times[:, None].float()).dtype == torch.float32


@pytest.mark.parametrize("floor", [None, 0.5])
@pytest.mark.parametrize("origin", [(500_000.0, 0.0, 4_500_000.0), (-3.0, 2.0, 100.0)])
def test_another_frame_changes_coordinates_and_nothing_else(origin: Place, floor: float | None) -> None:
    seed = (0.5, 1.2, 0.0)
    cart = MovingObject(TABLE, Trajectory((0, 2), ((0, 0, 0), (1, 0, 0)), (0, 1)))
    shapes = [BALL, Cylinder((1, 1, 1), 0.2, 1.0), Box((0, 1, 0), (1, 1, 1), 0.4), Plane((0, 0.1, 0), (0, 1, 1))]
    here = Scene([walls()], shapes, floor, objects=[cart], resolution=32, cache=None, free_space=seed)
    seen = here.seen_from(origin)
    where, when = points(), 2 * torch.rand(300, dtype=torch.float64)
    away = where - torch.tensor(origin, dtype=torch.float64)
    torch.testing.assert_close(seen.distance(away, when), here.distance(where, when), atol=1e-6, rtol=0)
    np.testing.assert_allclose(
        seen.distance_exact(away.numpy(), when.numpy()), here.distance_exact(where.numpy(), when.numpy()), atol=1e-6
    )
    np.testing.assert_allclose(seen.bounds + origin, here.bounds, atol=1e-8)
    assert seen.floor.height + origin[1] == pytest.approx(here.floor.height, abs=1e-8)
    assert seen.middle is not None and np.allclose(seen.middle + origin, here.middle)
    again = seen.seen_from(HOME)
    np.testing.assert_allclose(again.distance_exact(where.numpy()), here.distance_exact(where.numpy()), atol=1e-6)
    assert replace(again.baking, free_space=seed) == here.baking and np.allclose(again.baking.free_space, seed)
    assert again.stated_floor == floor and again.name == here.name and again.objects[0].trajectory == cart.trajectory
    assert here.seen_from(HOME) is here
    frame, *others = seen.doubts
    assert str(list(origin)) in frame and "frame" in frame and tuple(others) == here.doubts


def test_the_middle_is_that_of_meshes_or_else_of_shapes() -> None:
    far = Box((900, 0, 0), (1, 1, 1))
    assert np.allclose(Scene([TABLE.mesh()], [far]).middle, TABLE.center) and Scene.empty().middle is None
    assert np.allclose(Scene([], [far, Plane((0, 0, 0))]).middle, (900, 0, 0))


def test_an_empty_scene_is_a_floor() -> None:
    scene = Scene.empty(floor=0.5)
    p = points(20)
    torch.testing.assert_close(scene.distance(p), p[:, 1] - 0.5)
    assert np.allclose(scene.distance_exact(p.numpy()), p[:, 1].numpy() - 0.5)
    assert scene.floor.height == 0.5 and not scene.floor.found
    assert scene.bounds[0, 1] == 0.5 and scene.report() == []
    assert len(Scene(primitives=[BALL]).fields) == 2  # without meshes the floor is at 0


def test_the_floor_is_stated_or_found() -> None:
    stated = Scene([walls()], floor=0.1, resolution=16, cache=None)
    assert stated.floor.height == 0.1 and isinstance(stated.fields[-1], Plane)
    found = Scene([walls()], resolution=16, cache=None)
    assert found.floor.found and found.floor.height == pytest.approx(0.0, abs=0.02)
    assert len(found.fields) == 1


@pytest.mark.parametrize("offset", [0.0, 700.0])
@pytest.mark.parametrize("height", [-1.0, -0.11, -0.09, 0.0, 0.09, 0.3, 9.0])
def test_a_stated_floor_that_no_mesh_has_is_in_doubt(height: float, offset: float) -> None:
    here = Scene([walls()], floor=height, resolution=24, cache=None)
    doubts = here.seen_from((0.0, offset, 0.0)).doubts if offset else here.doubts
    told = [doubt for doubt in doubts if "the floor is stated" in doubt]
    near = abs(height) <= 0.1
    assert len(told) == (not near)
    assert near or f"stated at {height:g} m, but that of the mesh lies at 0.000 m" in told[0]


def test_a_floor_under_furniture_or_on_any_storey_is_none_of_doubt() -> None:
    legs = [Box((x, 0.35, z), (0.05, 0.7, 0.05)).mesh() for x in (-0.5, 0.5) for z in (-0.5, 0.5)]
    table = [Box((0, 0.75, 0), (1.2, 0.1, 1.2)).mesh(), *legs]
    shelf = Box((0, -0.6, 0), (4.0, 0.2, 3.0)).mesh()  # walls() stands on it, a storey higher
    for scene in (
        Scene(table, floor=0.0, resolution=24, cache=None),
        Scene([walls()], [Box((0, 0.2, 0), (2.0, 0.4, 2.0))], 0.4, resolution=24, cache=None),
        Scene([walls()], resolution=24, cache=None),
        Scene([Mesh(shelf.vertices, shelf.faces, "shelf")], floor=-0.5, resolution=24, cache=None),
        Scene.empty(3.0),
        *(bundled(name, resolution=48, cache=None) for name in bundled_names()),
    ):
        assert not [doubt for doubt in scene.doubts if "the floor is stated" in doubt]


def test_bounds_hold_meshes_shapes_and_the_ways_of_moving_ones() -> None:
    runner = Sphere((0, 0, 0), 0.5, Waypoints((0.0, 1.0), ((0, 1, 0), (7, 1, 0))))
    scene = Scene([walls()], [runner], cache=None)
    assert np.allclose(scene.bounds, [[-2, 0, -1.5], [7.5, 2.5, 1.5]], atol=0.01)


def test_describing_a_scene_bakes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("baked")

    monkeypatch.setattr(module, "bake", refuse)
    scene = Scene([walls()], [BALL])
    assert scene.bounds.shape == (2, 3) and len(scene.digest) == 64 and Scene([walls()], floor=0.1).floor.height == 0.1
    assert np.isfinite(scene.distance_exact(np.zeros((1, 3)), 0.0)).all()  # the oracle needs no grid either
    with pytest.raises(AssertionError, match="baked"):
        scene.report()
    with pytest.raises(AssertionError, match="baked"):
        _ = scene.floor  # where it is not stated: it has free space above it


def test_the_digest_knows_everything_distances_depend_on() -> None:
    def variants() -> list[Scene]:
        return [
            Scene([walls()]),
            Scene([TABLE.mesh()]),
            Scene([walls()], [BALL]),
            Scene([walls()], floor=0.0),
            Scene([walls()], resolution=64),
            Scene([walls()], free_space="outside"),
            Scene([walls()], [TABLE]),
            Scene([walls()], thickness=0.05),
            Scene([walls()], spacing=0.05),
            Scene([walls()], padding=0.3),
        ]

    digests = [scene.digest for scene in variants()]
    assert len(set(digests)) == len(digests) and digests == [scene.digest for scene in variants()]


def test_a_seed_speaks_for_the_room_and_not_for_the_furniture() -> None:
    room, air = ROOM.mesh(), (-1.0, 1.0, 0.5)  # drawn with outward walls
    scene = Scene([room, TABLE.mesh()], free_space=air, resolution=24, cache=None)
    p = torch.tensor([air, TABLE.center, (0, 2.55, 0)], dtype=torch.float64)
    assert scene.distance(p).sign().tolist() == [1, -1, -1]
    assert np.sign(scene.distance_exact(p.numpy())).tolist() == [1, -1, -1]
    with pytest.raises(UserError, match="lies outside mesh"):
        Scene([room, TABLE.mesh()], free_space=(9, 9, 9), resolution=8, cache=None).report()


def test_walls_without_thickness_are_given_one_in_grid_and_score_alike() -> None:
    corners = np.array([[-1.0, 0, 0], [1, 0, 0], [1, 2, 0], [-1, 2, 0]])
    wall = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), "wall")
    scene = Scene([wall], resolution=64, cache=None, thickness=0.12, free_space="outside")
    near = np.random.default_rng(0).uniform([-0.9, 0.1, -0.2], [0.9, 1.9, 0.2], (200, 3))
    exact = scene.distance_exact(near)
    assert np.allclose(exact, np.abs(near[:, 2]) - 0.06)
    voxel = scene.bakes[0].grid.spacing
    assert np.abs(scene.distance(torch.from_numpy(near)).numpy() - exact).max() < voxel
    assert scene.bakes[0].grid.bounds[1, 2] >= 0.06 + 0.09  # room for the wall and beyond
    assert scene.digest != Scene([wall], resolution=64, cache=None, free_space="outside").digest
    with pytest.raises(UserError, match="thickness is -1 m; give 0 to 10 m"):
        Scene([wall], thickness=-1)


def test_bad_values_are_one_sentence(tmp_path: Path) -> None:
    for message, build in [
        ("resolution is 4", lambda: Scene(resolution=4)),
        ("padding is -1 m", lambda: bundled("stairs", padding=-1)),
        ("spacing is 0", lambda: bundled("stairs", spacing=0)),
        ("did you mean 'auto'", lambda: Scene(free_space="aut")),
        ("floor height is nan", lambda: Scene(floor=float("nan"))),
        ("does not exist", lambda: load_scene(tmp_path / "none.ply")),
        (f"did you mean '{bundled_names()[0]}'", lambda: bundled(bundled_names()[0] + "s")),
        (r"give \[n, 3\]", lambda: Scene.empty().distance_exact(np.zeros(3))),
        ("NaN or infinite", lambda: Scene.empty().distance_exact(np.full((1, 3), np.nan))),
    ]:
        with pytest.raises(UserError, match=message) as caught:
            build()
        assert "\n" not in str(caught.value)


def test_the_bundled_files_have_one_place_under_their_new_and_their_old_name() -> None:
    import scenes
    from scenes.scene import BUNDLED  # as the first examples wrote it

    assert BUNDLED is scenes.BUNDLED and (BUNDLED / "living_room.glb").is_file()


def test_load_scene_reads_file_and_options(tmp_path: Path) -> None:
    import trimesh

    trimesh.Trimesh(walls().vertices * 100, walls().faces).export(tmp_path / "room.stl")
    scene = load_scene(tmp_path / "room.stl", unit="cm", floor=0, resolution=16, primitives=[BALL], cache=None)
    assert scene.name == "room" and len(scene.fields) == 3
    assert np.allclose(scene.bounds, ROOM.mesh().bounds, atol=1e-4)
    assert "faces inward" in scene.report()[0]


def test_two_hundred_thousand_points_take_no_python_loop(scene: Scene) -> None:
    import time

    p = points(200_000).float().requires_grad_()
    scene.distance(p[:10]).sum().backward()
    start = time.process_time()
    scene.distance(p).sum().backward()
    assert time.process_time() - start < 2.0  # a loop would take minutes
