"""Pictures: what is drawn where, by looking at geometry and at pixels."""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch

from objectives import Mark, Masked, Objective, Term, forget, goal
from scenectl.view import Picture, draw_scene
from scenectl.view.camera import Sight, choose
from scenectl.view.evidence import uncertain_blocks
from scenectl.view.marks import draw_line, draw_mark, places
from scenectl.view.room import Room
from scenectl.view.shapes import body_hull, capsules, components, soft_shadow
from scenectl.view.stage import open_stage
from scenectl.view.window import Window
from scenes.body.body import DEFAULT_BODY
from scenes.mesh.colours import face_colours
from scenes.mesh.mesh import Mesh, load_mesh
from scenes.mesh.primitives import Box, Sphere
from scenes.mesh.surface import Surface
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.waypoints import Waypoints
from scenes.sdf.signs import UNCERTAIN
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import Scene, bundled
from tests.scenes.mesh.test_gltf import boxes
from tests.scenes.world.floor.grounds import storeys

if TYPE_CHECKING:
    from pyvista import Plotter

SMALL = (320, 200)


def walk(tiny: ModuleType, frames: int = 41, x: float = 0.0) -> Motion:
    """A statue that slides 2 m along +z."""
    way = torch.zeros(frames, 1, 3)
    way[:, 0, 2] = torch.linspace(0.0, 2.0, frames)
    return Motion(Pose2D((x, DEFAULT_BODY.sole_offset, 0.0)).apply(tiny.statue() + way))


def pixels(path: Path) -> np.ndarray:
    from PIL import Image

    with Image.open(path) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def reddish(image: np.ndarray) -> float:
    """Share of pixels in the colour of the last pose."""
    return float(((image[..., 0] > 1.6 * image[..., 1]) & (image[..., 0] > 1.8 * image[..., 2])).mean())


def test_bodies_are_the_capsules_that_are_scored(tiny: ModuleType) -> None:
    joints = tiny.statue().double()
    hull = body_hull(DEFAULT_BODY, joints.numpy())
    vertices, faces, normals = hull.points, hull.regular_faces, hull.point_data.active_normals
    assert vertices.shape == normals.shape
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)
    samples = DEFAULT_BODY.points_of(joints).numpy()
    away = np.linalg.norm(vertices[:, None] - samples[None], axis=2) - DEFAULT_BODY.radii().numpy()
    assert away.min(axis=1).max() < 0.03  # nothing is drawn far from what is scored
    assert faces.max() == len(vertices) - 1


def test_sight_is_blocked_by_what_is_between() -> None:
    wall = Box((0.0, 1.0, 2.0), (2.0, 2.0, 0.1)).mesh().triangles
    eye, behind, beside = np.array([0.0, 1.0, 5.0]), np.array([0.1, 1.1, 0.0]), np.array([3.0, 1.0, 0.0])
    assert len(Sight(wall, one_sided=False).covering(eye, behind)) > 0
    assert len(Sight(wall, one_sided=False).covering(eye, beside)) == 0
    # an inward-facing room turns its back to a camera outside: only the far side may cover
    room = Box((0.0, 1.0, 0.0), (6.0, 3.0, 6.0)).mesh().triangles[:, ::-1]
    assert len(Sight(room, one_sided=True).covering(np.array([0.0, 1.0, 9.0]), behind)) == 0
    assert len(Sight(room, one_sided=False).covering(np.array([0.0, 1.0, 9.0]), behind)) > 0


def test_the_camera_looks_past_walls(tiny: ModuleType) -> None:
    joints = walk(tiny).joints[::10].reshape(-1, 3).double().numpy()
    walls = [Box((s, 1.5, 1.0), (0.1, 3.0, 8.0)).mesh().triangles for s in (-1.5, 1.5)]
    walls.append(Box((0.0, 1.5, -3.0), (3.0, 3.0, 0.1)).mesh().triangles)
    sight = Sight(np.concatenate(walls), False)
    camera = choose(joints, sight, np.array([0.0, 1.0]), 1.6)
    assert np.mean([len(sight.covering(camera.position, p)) > 0 for p in joints]) < 0.1


def test_shadows_lie_under_bodies(tiny: ModuleType) -> None:
    samples = DEFAULT_BODY.points_of(tiny.statue() + torch.tensor([2.0, 0.0, -1.0])).double().numpy()
    x, z, dark = soft_shadow([samples], DEFAULT_BODY.radii().numpy(), [0.5])
    i, j = np.unravel_index(dark.argmax(), dark.shape)
    assert abs(x[i] - 2.0) < 0.3 and abs(z[j] + 1.0) < 0.3
    assert 0.3 < dark.max() <= 0.5
    assert dark[0].max() == dark[:, 0].max() == 0.0


def test_scenes_keep_their_colours_and_objects() -> None:
    mesh = bundled("doorway").meshes[0]
    assert len(np.unique(face_colours(mesh), axis=0)) > 2
    assert len(np.unique(components(mesh))) == 8
    plain = Mesh(np.eye(3), np.array([[0, 1, 2]]))
    assert face_colours(plain).tolist() == [[216, 211, 203]]


def test_colours_belong_to_their_faces_however_files_order_and_cut_them(tmp_path: Path) -> None:
    wall = ["0 0 0", "6 0 0", "6 3 0", "4 3 0", "4 1 0", "2 1 0", "2 3 0", "0 3 0"]
    text = "mtllib a.mtl\n" + "\n".join(f"v {corner}" for corner in wall) + "\nv 0 0 9\nv 6 0 9\nv 0 3 9\n"
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n")
    faces = "usemtl blue\nf 9 10 11\nusemtl red\nf 1 2 3 4 5 6 7 8\nusemtl blue\nf 9 10 1\n"
    (tmp_path / "a.obj").write_text(text + faces)
    for up in ("y", "z"):
        mesh = load_mesh(tmp_path / "a.obj", "m", up)
        wall_faces = (mesh.faces < 8).all(axis=1)
        colours = face_colours(mesh)
        assert (colours[wall_faces] == [255, 0, 0]).all() and (colours[~wall_faces] == [0, 0, 255]).all()


def test_what_moves_keeps_the_colours_of_its_file_wherever_it_begins() -> None:
    cart = load_mesh(Path(__file__).resolve().parents[3] / "examples" / "tasks" / "cart.glb")
    away = Scene(objects=[MovingObject(cart, Trajectory([0.0], [(5.0, 0.0, -7.0)], [1.0]))])
    assert (Room(away, 1.8).moving_colours[0] == face_colours(cart)).all()


def test_instances_that_the_colour_reader_does_not_know_are_drawn(tmp_path: Path) -> None:
    file = boxes()
    attributes = {"TRANSLATION": file.add(np.array([[0.0, 0, 0], [5, 0, 0], [9, 0, 0]]))}
    file.facts["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    assert face_colours(load_mesh(file.save(tmp_path / "a.glb"))).shape == (36, 3)


@pytest.mark.parametrize("what", ["room", "goals"])
def test_pictures_show_the_person(what: str, tiny: ModuleType, tmp_path: Path) -> None:
    if what == "room":  # a closed room around the person: without cutting it open nobody would be seen
        shell = Box((0.0, 1.4, 1.0), (3.0, 2.8, 5.0)).mesh()
        scene = Scene([Mesh(shell.vertices, shell.faces[:, ::-1])], resolution=24, cache=None)
        picture = Picture(scene, walk(tiny))
    else:
        ball = Sphere((1.0, 1.0, 1.0), 0.3, Waypoints((0.0, 2.0), ((1.0, 1.0, 1.0), (2.0, 1.0, 1.0))))
        terms = (
            Term("joint_target", {"position": [0.0, 2.0]}, at=1.0),
            Term("joint_target", {"joint": "head", "position": [0.0, 1.6, 2.0]}, at=1.0),
            Term("square_region", {"half": 1.5}),
            Term("sphere_repulsion", {"center": [-1.0, 1.0, 1.0], "radius": 0.2}),
            Term("joint_target", {"track": {"kind": "line", "start": [0, 1, 0], "end": [0, 1, 2], "times": [0, 1]}}),
        )
        path = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
        picture = Picture(Scene(primitives=[ball]), walk(tiny), path, Objective(terms), "title")
    picture.draw(tmp_path / "picture.png", size=SMALL)
    image = pixels(tmp_path / "picture.png")
    assert image.shape == (200, 320, 3)
    assert reddish(image) > (0.03 if what == "room" else 0.01)  # half of it where walls are not cut away


def test_clearance_colours_and_slices(tiny: ModuleType, tmp_path: Path) -> None:
    scene = Scene(primitives=[Box((0.45, 1.0, 0.0), (0.2, 2.0, 1.0))])
    picture = Picture(scene, walk(tiny))
    clearance = picture.clearances(body_hull(DEFAULT_BODY, picture.joints(0)).points, 0)
    assert clearance.min() < 0.15 and clearance.max() <= 1.8
    grid = picture.slice_at(1.0)
    inside = scene.distance(torch.tensor([[0.45, 1.0, 0.0]]))
    assert float(inside) == pytest.approx(-0.1, abs=1e-5)
    assert grid["distance (m)"].min() == pytest.approx(-0.1, abs=0.05)
    picture.draw(tmp_path / "p.png", at=0.0, show_slice=True, clearance=True, size=SMALL)
    assert pixels(tmp_path / "p.png").std() > 10


def moving_scene() -> Scene:
    """A box that turns by a quarter while it comes 2 m nearer, and a ball that rises."""
    way = Trajectory((0.0, 2.0), ((3.0, 0.0, 2.0), (1.0, 0.0, 2.0)), headings=(0.0, np.pi / 2))
    ball = Sphere((-1.0, 0.5, 1.0), 0.2, Waypoints((0.0, 2.0), ((-1.0, 0.5, 1.0), (-1.0, 1.5, 1.0))))
    return Scene(primitives=[ball], objects=[MovingObject(Box((0.0, 0.5, 0.0), (0.2, 1.0, 0.6)), way)])


def bounds(stage: Plotter, name: str) -> tuple[float, ...]:
    """Lowest and highest x, y and z of something on a stage."""
    found: tuple[float, ...] = stage.actors[name].bounds
    return found


def test_what_moves_is_drawn_where_it_is_when_the_body_is(tiny: ModuleType) -> None:
    picture = Picture(moving_scene(), walk(tiny))
    stage = open_stage(SMALL)
    try:
        poses = [moment.frame for moment in picture.moments(None)]
        picture.room.draw_moving(stage, [picture.time(frame) for frame in poses])
        assert [round(picture.time(frame), 6) for frame in (poses[0], poses[-1])] == [0.0, 2.0]
        for share, i in ((frame / 40, i) for i, frame in enumerate(poses)):
            x0, x1, *_ = bounds(stage, f"moving 0 {i}")
            assert (x0 + x1) / 2 == pytest.approx(3.0 - 2.0 * share, abs=1e-5)
            turn = share * np.pi / 2
            assert (x1 - x0) / 2 == pytest.approx(0.1 * np.cos(turn) + 0.3 * np.sin(turn), abs=1e-5)
            assert bounds(stage, f"moving 1 {i}")[3] == pytest.approx(0.7 + share, abs=1e-5)
        assert stage.actors[f"moving 0 {len(poses) - 1}"].prop.opacity == 1.0
        assert stage.actors["moving 0 0"].prop.opacity < 0.3
        assert not len(picture.room.solid.triangles)  # and never where it was at 0 s as well
    finally:
        stage.close()


def test_pictures_ask_for_the_moments_they_show(
    tiny: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[list[float]] = []
    monkeypatch.setattr(Room, "draw_moving", lambda self, stage, times: asked.append(times))
    picture = Picture(moving_scene(), walk(tiny))
    picture.draw(tmp_path / "all.png", size=SMALL)
    picture.draw(tmp_path / "one.png", at=1.5, size=SMALL)
    Picture(moving_scene()).draw(tmp_path / "scene.png", size=SMALL)
    assert asked == [pytest.approx([0.0, 0.65, 1.35, 2.0], abs=0.06), pytest.approx([1.5]), [0.0]]


def test_slices_and_the_window_follow_what_moves(tiny: ModuleType) -> None:
    rolling = {"kind": "line", "start": [-2.0, 1.0, 0.0], "end": [-4.0, 1.0, 0.0], "times": [0.0, 2.0]}
    objective = Objective((Term("sphere_repulsion", {"center": rolling, "radius": 0.25}),))
    picture = Picture(moving_scene(), walk(tiny), objective=objective)
    for time, x in ((0.0, 3.0), (2.0, 1.0)):
        grid = picture.slice_at(0.5, time)
        right = np.where(grid.points[:, 0] > 0, grid["distance (m)"], np.inf)
        deepest = grid.points[right.argmin()]
        assert deepest[0] == pytest.approx(x, abs=0.25) and deepest[2] == pytest.approx(2.0, abs=0.25)
    stage = open_stage(SMALL)
    window = Window(picture, stage)
    try:
        assert sum(bounds(stage, "moving 0 0")[:2]) / 2 == pytest.approx(3.0, abs=1e-5)
        assert bounds(stage, "goal 0, mark 0 0")[:2] == pytest.approx((-2.25, -1.75), abs=0.01)
        window.at(1.0)
        assert sum(bounds(stage, "moving 0 0")[:2]) / 2 == pytest.approx(2.0, abs=1e-5)
        assert bounds(stage, "goal 0, mark 0 0")[:2] == pytest.approx((-3.25, -2.75), abs=0.01)
        assert sum(name.startswith(("moving 0", "goal 0")) for name in stage.actors) == 2
    finally:
        stage.close()


def test_contacts_are_marked_on_the_body_while_they_last(tiny: ModuleType) -> None:
    motion = walk(tiny)
    objective = Objective((Term("contact", {"part": "left_hand"}, window=(0.5, 1.0), tolerance=9.0),))
    picture = Picture(Scene.empty(), motion, objective=objective)
    stage = open_stage(SMALL)
    try:
        window = Window(picture, stage)
        for time, there in ((0.0, False), (0.8, True), (1.5, False)):
            window.at(time)
            assert ("goal 0, mark 0 0" in stage.actors) == there
            if there:
                wrist = picture.wrists(picture.frame_at(time))[0]
                middle = np.reshape(bounds(stage, "goal 0, mark 0 0"), (3, 2)).mean(axis=1)
                assert np.linalg.norm(middle - wrist) < 0.15
    finally:
        stage.close()


def test_what_is_in_a_hand_is_drawn_beside_the_person_in_its_colours(tiny: ModuleType) -> None:
    motion = walk(tiny)
    wrist = motion.joint("right_wrist").double()
    box = Box((0.0, 0.0, 0.0), (0.1, 0.1, 0.1)).mesh()
    path, away = (Trajectory(motion.times.tolist(), places.tolist()) for places in (wrist, wrist + 1.0))
    scene, far = (Scene(objects=[MovingObject(box, way)], floor=0.0) for way in (path, away))
    turned = np.array([[0.0, 0.0, 1.0, 5.0], [0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    for room, there in ((scene, True), (far, False)):
        picture = Picture(room, motion)
        stage = open_stage(SMALL)
        try:
            picture.room.draw_in_hands(stage, picture.time(10), picture.wrists(10), turned, "person 3")
            assert ("person 3, thing 0" in stage.actors) == there
            if there:
                middle = np.reshape(bounds(stage, "person 3, thing 0"), (3, 2)).mean(axis=1)
                assert middle == pytest.approx((turned @ [*wrist[10].tolist(), 1.0])[:3], abs=0.01)
                drawn = stage.actors["person 3, thing 0"].mapper.dataset["colour"]
                assert (drawn[0] == picture.room.moving_colours[0][0]).all()
        finally:
            stage.close()


def torn_box() -> Mesh:
    """A box of which every triangle is apart from the next, beside a closed one."""
    mesh = Box((0.0, 0.5, 0.0), (1.0, 1.0, 1.0)).mesh()
    centre = mesh.triangles.mean(axis=1, keepdims=True)
    corners = (centre + 0.9 * (mesh.triangles - centre))[2:]
    return Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), "torn")


def test_uncertain_voxels_and_holes_are_shown_where_they_are(tmp_path: Path) -> None:
    scene = Scene([torn_box()], resolution=40, cache=None)
    (result,) = scene.bakes
    blocks = uncertain_blocks(result)
    assert blocks is not None and result.signs.uncertain is not None

    nodes = result.grid.nodes(np.argwhere(result.signs.uncertain))
    assert (blocks.find_containing_cell(nodes) >= 0).all()
    sure = result.grid.nodes(np.argwhere(~result.signs.uncertain))
    assert (blocks.find_containing_cell(sure) < 0).all()  # a block is one voxel here
    percent = blocks["agreeing evidence (%)"]
    assert len(percent) == len(nodes) and percent.max() <= UNCERTAIN
    assert np.allclose(blocks.cell_centers().points, nodes[np.lexsort(nodes.T)])
    edges = Surface.of(torn_box()).open_edges
    assert len(edges) == result.boundary_edges == 30
    ends = edges.reshape(-1, 3)
    assert np.abs(ends[:, None] - torn_box().vertices).sum(axis=2).min(axis=1).max() < 1e-9
    draw_scene(scene, tmp_path / "signs.png", show_signs=True)
    draw_scene(scene, tmp_path / "plain.png")
    red = [reddish(pixels(tmp_path / f"{name}.png")) for name in ("signs", "plain")]
    assert red[0] > 2 * red[1] + 1e-3


def test_scenes_alone(tmp_path: Path) -> None:
    draw_scene(bundled("doorway", resolution=48), tmp_path / "scene.png")
    assert pixels(tmp_path / "scene.png").std() > 15


def test_the_window_moves_through_time(tiny: ModuleType) -> None:
    picture = Picture(Scene(primitives=[Box((1.0, 1.0, 0.0), (0.2, 2.0, 1.0))]), walk(tiny))
    stage = open_stage(SMALL)
    window = Window(picture, stage)
    try:
        place = bounds(stage, "body")[4]
        window.at(2.0)
        assert window.frame == 40
        assert bounds(stage, "body")[4] - place == pytest.approx(2.0, abs=1e-3)
        window.step(-1)
        assert window.frame == 39
        window.toggle_slice()
        assert {"slice", "slice surface"} <= set(stage.actors)
        assert set(stage.scalar_bars.keys()) == {"distance (m)"}
        window.at_height(0.5)
        assert bounds(stage, "slice")[2] == pytest.approx(0.5, abs=1e-3)
        window.toggle_clearance()
        assert set(stage.scalar_bars.keys()) == {"distance (m)", "clearance (m)"}
        window.toggle_clearance()
        window.toggle_slice()
        assert not {"slice", "slice surface"} & set(stage.actors)
        assert not set(stage.scalar_bars.keys())
    finally:
        stage.close()


def test_surfaces_face_outwards() -> None:
    """Shading takes the side of a surface from its corners' order, and its slope from the normals."""
    ends = np.array([[0.0, 0, 0], [1.0, 2, 0]]), np.array([[0.0, 0, 0], [1.0, 2, 1]])
    hull = capsules(*ends, np.array([[0.2, 0.2], [0.1, 0.3]]))
    normals = hull.point_data.active_normals
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6)
    a, b, c = np.moveaxis(hull.points[hull.regular_faces], 1, 0)
    across = np.cross(b - a, c - a)
    outward = (across * normals[hull.regular_faces].mean(axis=1)).sum(-1)
    assert (outward[np.linalg.norm(across, axis=1) > 1e-6] > 0).all()


def test_arrows_go_from_one_point_to_the_other() -> None:
    stage = open_stage(SMALL)
    try:
        ends = np.array([[0.0, 1.0, 0.0], [0.3, 1.4, 0.0]])
        draw_mark(stage, Mark("arrow", torch.from_numpy(ends)), ends)
        draw_mark(stage, Mark("arrow", torch.from_numpy(ends)), np.full((2, 3), np.nan))  # nowhere
        (drawn,) = stage.actors.values()
        along = (drawn.mapper.dataset.points - ends[0]) @ (ends[1] - ends[0]) / 0.5
        assert [along.min(), along.max()] == pytest.approx([0.0, 0.5], abs=1e-3)
        away = np.linalg.norm(np.cross(drawn.mapper.dataset.points - ends[0], ends[1] - ends[0]), axis=-1) / 0.5
        assert away[along < 0.3].max() == pytest.approx(0.018, abs=1e-3) and away.max() == pytest.approx(0.05, abs=1e-3)
    finally:
        stage.close()


def test_marks_lie_on_the_storey_of_the_person(tiny: ModuleType) -> None:
    for y in (0.0, 2.72):
        motion = tiny.statue() + torch.tensor([0.5, y, -1.0])
        goals = Objective((Term("joint_target", {"joint": "pelvis", "position": [0.5, -0.5]}, at=0.0),))
        picture = Picture(storeys(), Motion(motion.expand(5, 22, 3)), objective=goals)
        (mark,) = picture.marks
        assert places(mark, picture.ground)[0] == pytest.approx([0.5, y + 0.02, -0.5], abs=1e-3)
        assert picture.hip_height == pytest.approx(y + 0.9, abs=1e-3)


def test_lines_are_as_thick_along_every_leg() -> None:
    stage = open_stage(SMALL)
    try:
        way = np.array([[0.0, 0, 0], [0.0, 0.5, 0.2], [0.0, 0.5, 0.2], [1.0, 0.5, 0.2], [1.0, 0.5, 1.2]])
        draw_line(stage, way, (0, 0, 0), 0.1)
        draw_line(stage, way[1:3], (0, 0, 0), 0.1)  # of no length
        (line,) = stage.actors.values()
        legs = line.mapper.dataset.points.reshape(3, -1, 3)
        for leg, (here, there) in zip(legs, pairwise(way[[0, 1, 3, 4]]), strict=True):
            along = (there - here) / np.linalg.norm(there - here)
            assert np.linalg.norm(np.cross(leg - here, along), axis=-1) == pytest.approx(0.1, abs=1e-5)
            ends = (leg - here) @ along
            assert [ends.min(), ends.max()] == pytest.approx([0.0, np.linalg.norm(there - here)], abs=1e-6)
    finally:
        stage.close()


def test_scales_run_from_their_first_colour_to_their_last(tiny: ModuleType) -> None:
    stage = open_stage(SMALL)
    try:
        Picture(Scene(primitives=[Box((1.0, 1.0, 0.0), (0.2, 2.0, 1.0))]), walk(tiny)).draw_body(
            stage, 0, True, name="body"
        )
        body = stage.actors["body"]
        table = body.mapper.lookup_table
        assert body.mapper.scalar_range == table.scalar_range == (0.0, 0.4)
        colours = [table.map_value(value)[:3] for value in (-9.0, 0.0, 0.4, 9.0)]
        assert np.round(255 * np.array(colours)).tolist() == 2 * [[165, 0, 38]] + 2 * [[0, 104, 55]]
    finally:
        stage.close()


def test_goals_of_a_users_own_are_drawn_and_held_in_the_picture(tiny: ModuleType, tmp_path: Path) -> None:
    @goal(unit="m", pulls=True)
    def fetched(motion: Motion, context: object, *, x: float) -> Masked:
        """Bring the head to a place that no parameter of a known type states."""
        points = motion.select(["head"])
        targets = points.new_tensor([x, 1.0, 1.0]).expand(points.shape)
        return Masked((points - targets).flatten(-2), sizes=3, labels=["head"], points=points, targets=targets)

    try:
        shares = []
        for terms in ((), (Term("fetched", {"x": 1.5}, tolerance=0.3),)):
            picture = Picture(Scene.empty(), walk(tiny), objective=Objective(terms))
            picture.draw(tmp_path / "picture.png", size=SMALL)
            red, green, blue = np.moveaxis(pixels(tmp_path / "picture.png"), -1, 0)
            shares.append(((red > 2.5 * green) & (blue > 0.7 * green)).mean())  # redder than the person
        assert shares[0] == 0.0 and shares[1] > 0.005
    finally:
        forget("fetched")


def test_nothing_is_loaded_that_is_not_drawn_with(tmp_path: Path) -> None:
    """pyvista when a picture is drawn and not before, with what it loads itself."""
    code = (
        "import sys\n"
        "from scenectl.view import draw_scene\n"
        "from scenes.world.scene import Scene\n"
        "heavy = lambda: sorted({'vtkmodules', 'vtk', 'pyvista', 'matplotlib', 'open3d'} & set(sys.modules))\n"
        f"print(heavy()); draw_scene(Scene.empty(), {str(tmp_path / 'scene.png')!r}); print(heavy())\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["[]", "['matplotlib', 'pyvista', 'vtkmodules']"]
    assert done.stderr == ""
