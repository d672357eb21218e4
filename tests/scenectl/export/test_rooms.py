"""What is seen of a scene: its triangles, their colours, and where what moves is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from scenectl.export.rooms import MARGIN, Thing, things
from scenes.mesh.colours import CLAY, OBSTACLE, face_colours
from scenes.mesh.mesh import load_mesh
from scenes.mesh.primitives import Box, Capsule, Cylinder, Plane, Sphere
from scenes.motion.waypoints import Waypoints
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import BUNDLED, Scene

TIMES = np.linspace(0.0, 2.0, 9)
PERSON = np.array([[0.0, 0.0, 0.0], [0.5, 1.7, 3.0]])


def triangles(thing: Thing, frame: int) -> np.ndarray:
    corners = thing.vertices[thing.faces]
    if thing.places is None or thing.turns is None:
        return corners
    turned = Rotation.from_quat(thing.turns[frame], scalar_first=True).apply(corners.reshape(-1, 3))
    return turned.reshape(-1, 3, 3) + thing.places[frame]


def test_all_solids_are_there_once() -> None:
    shapes = [Box((0, 1, 0), (1, 1, 1), 0.4), Box((3, 1, 0), (1, 1, 1)), Cylinder((0, 1, 4), 0.3, 2.0)]
    found = {thing.name: thing for thing in things(Scene(primitives=shapes), TIMES, PERSON)}
    assert list(found) == ["box", "box 2", "cylinder", "floor"]
    for thing, shape in zip(found.values(), shapes, strict=False):
        np.testing.assert_array_equal(triangles(thing, 0), shape.mesh().triangles)
        assert thing.places is None and (thing.colours == CLAY).all() and len(thing.colours) == len(thing.faces)


@given(
    st.lists(st.tuples(*[st.floats(-3, 3)] * 3), min_size=3, max_size=3),
    st.lists(st.floats(-3, 3), min_size=3, max_size=3),
    st.floats(-1, 3),
)
@settings(max_examples=10, deadline=None)
def test_what_moves_is_where_the_scene_has_it(
    places: list[tuple[float, ...]], headings: list[float], t0: float
) -> None:
    way = Waypoints([0.0, 0.7, 1.5], places)
    turning = Trajectory(way.times, places, headings)
    scene = Scene(
        primitives=[Sphere((9, 9, 9), 0.3, way), Capsule((0, 0, 0), (1, 1, 0), 0.2, way)],
        objects=[MovingObject(Box((1.0, 0.5, 0.0), (1.0, 1.0, 0.1)), turning, "door")],
    )
    found = {thing.name: thing for thing in things(scene, t0 + TIMES)}
    for name, thing in zip(("door", "sphere", "capsule"), scene.moving, strict=True):
        mine = found[name]
        assert mine.turns is not None and (mine.colours == OBSTACLE).all()
        assert ((mine.turns[1:] * mine.turns[:-1]).sum(axis=1) > 0).all()
        for frame, time in enumerate(t0 + TIMES):
            np.testing.assert_allclose(triangles(mine, frame), thing.mesh(float(time)).triangles, atol=1e-9)


def test_files_bring_their_colours_and_their_floor() -> None:
    mesh = load_mesh(BUNDLED / "living_room.glb")
    (thing,) = things(Scene([mesh], floor=0.0), TIMES)
    np.testing.assert_array_equal(triangles(thing, 0), mesh.triangles)
    np.testing.assert_array_equal(thing.colours, face_colours(mesh))
    assert len(np.unique(thing.colours, axis=0)) > 5


def test_a_moving_file_keeps_its_colours_wherever_it_begins() -> None:
    cart = load_mesh(Path(__file__).resolve().parents[3] / "examples" / "tasks" / "cart.glb")
    away = Scene(objects=[MovingObject(cart, Trajectory([0.0], [(5.0, 0.0, -7.0)], [1.0]))])
    thing = things(away, TIMES)[0]
    np.testing.assert_array_equal(thing.colours, face_colours(cart))


def test_a_floor_without_an_end_lies_under_all_that_stands_and_walks() -> None:
    empty = things(Scene.empty(0.3), TIMES, PERSON)[0]
    low, high = empty.vertices.min(axis=0), empty.vertices.max(axis=0)
    np.testing.assert_allclose([low, high], [[-MARGIN, 0.3, -MARGIN], [0.5 + MARGIN, 0.3, 3.0 + MARGIN]], atol=1e-6)
    a, b, c = np.moveaxis(triangles(empty, 0), 1, 0)
    assert (np.cross(b - a, c - a)[:, 1] > 0).all()  # seen from above
    assert np.ptp(things(Scene.empty(), TIMES)[0].vertices[:, 0]) >= 40.0


@pytest.mark.parametrize("away", [(0.0, 0.0, 0.0), (5e5, 0.0, -4.65e6)])
def test_a_floor_reaches_from_things_to_people_wherever_both_are(away: tuple[float, float, float]) -> None:
    box = Box((away[0] + 1.0, 0.5, away[2]), (0.5, 1.0, 0.5))
    floor = things(Scene(primitives=[box]), TIMES, PERSON + away)[-1]
    low, high = floor.vertices.min(axis=0) - away, floor.vertices.max(axis=0) - away
    np.testing.assert_allclose(low[[0, 2]], [-MARGIN, -0.25 - MARGIN], atol=1e-6)
    np.testing.assert_allclose(high[[0, 2]], [1.25 + MARGIN, 3.0 + MARGIN], atol=1e-6)


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda n: np.linalg.norm(n) > 0.1), st.floats(-1.0, 1.0))
@settings(max_examples=30, deadline=None)
def test_planes_are_cut_to_the_room(normal: tuple[float, float, float], off: float) -> None:
    middle = PERSON.mean(axis=0)
    unit = np.array(normal) / np.linalg.norm(normal)
    far = np.cross(unit, [0.3, 0.4, 0.5]) * 50  # stated at any of its points
    plane = Plane(tuple((middle + off * unit + far).tolist()), normal)
    found = {thing.name: thing for thing in things(Scene(primitives=[plane]), TIMES, PERSON)}
    corners = found["plane"].vertices
    np.testing.assert_allclose((corners - middle) @ unit, off, atol=1e-6)
    assert (corners > PERSON[0] - MARGIN - 1e-6).all() and (corners < PERSON[1] + MARGIN + 1e-6).all()
    a, b, c = np.moveaxis(triangles(found["plane"], 0), 1, 0)
    across = np.cross(b - a, c - a)
    assert (across @ unit > -1e-12).all() and np.linalg.norm(across, axis=1).sum() > 0.1


def test_planes_elsewhere_are_not_seen() -> None:
    assert [thing.name for thing in things(Scene(primitives=[Plane((0, -50, 0))]), TIMES, PERSON)] == ["floor"]


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (5000.0, 0.0, -300.0)])
def test_frames_of_scenes_do_not_show(origin: tuple[float, float, float]) -> None:
    way = Waypoints([0.0, 2.0], [(5000.0, 1.0, -300.0), (5003.0, 1.0, -300.0)])
    world = Scene(primitives=[Box((5001, 1, -300), (1, 1, 1)), Sphere((0, 0, 0), 0.5, way)])
    for a, b in zip(things(world, TIMES), things(world.seen_from(origin), TIMES), strict=True):
        np.testing.assert_allclose(triangles(a, 3), triangles(b, 3), atol=1e-9)
