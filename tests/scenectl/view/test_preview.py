"""Previews: which moments they show and where, what is written, and that everyone who is drawn is seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st

from objectives import Context, Objective, Term
from scenectl.measures.believability.verdict import Finding, Verdict
from scenectl.pipeline.run import run
from scenectl.tasks.task import Task
from scenectl.view import Picture, of_folder, of_result
from scenectl.view.camera import Camera
from scenectl.view.caption import Caption, told
from scenectl.view.labels import COARSE, LONG, Label, cut, draw_labels, font, letters, plain, short, spots
from scenectl.view.moments import Moment, Shown
from scenectl.view.sheet import planned
from scenectl.view.stage import open_stage
from scenes.body.body import DEFAULT_BODY
from scenes.mesh.colours import face_colours
from scenes.mesh.mesh import Mesh, load_mesh
from scenes.mesh.primitives import Box
from scenes.motion.motion import Motion, Pose2D
from scenes.world.named import named_scene
from scenes.world.scene import Scene, bundled

SIZE = (640, 400)
IDS = [*[(r, g, b) for r in (0, 255) for g in (0, 255) for b in (0, 255)][1:7], (255, 102, 0), (0, 102, 255)]
"""Colours of people that are told apart."""


def moving(tiny: ModuleType, way: Sequence[Sequence[float]], fps: float = 20.0) -> Motion:
    """A statue that goes from place to place [x, z], each 2 s after the one before."""
    stops, times = np.array(way), 2.0 * np.arange(len(way))
    at = np.arange(0.0, times[-1] + 1e-9, 1 / fps)
    shift = torch.zeros(len(at), 1, 3)
    shift[:, 0, 0], shift[:, 0, 2] = (torch.tensor(np.interp(at, times, stops[:, k])) for k in (0, 1))
    return Motion(Pose2D((0.0, DEFAULT_BODY.sole_offset, 0.0)).apply(tiny.statue() + shift))


def at_times(picture: Picture, moments: Sequence[Moment]) -> list[float]:
    return [round(picture.time(moment.frame), 2) for moment in moments]


def judged(picture: Picture) -> Picture:
    assert picture.motion is not None and picture.objective is not None
    (reports,) = picture.objective.report(picture.motion, Context(picture.scene, picture.body))
    return replace(picture, reports=reports)


def test_moments_are_those_that_goals_are_about(tiny: ModuleType) -> None:
    motion = moving(tiny, [(0, 0), (0, 2), (0, 4)])
    goals = Objective(
        (
            Term("joint_target", {"joint": "pelvis", "position": [0.0, 1.3]}, at=[0.7, 3.3], name="two times"),
            Term("joint_target", {"joint": "head", "position": [0.0, 9.0, 0.0]}, window=[1.2, 2.0], name="window"),
            Term("joint_target", {"joint": "pelvis", "position": [0.0, 2.5]}, sometime=[2.1, 4.0], name="sometime"),
        )
    )
    picture = Picture(Scene.empty(), motion, objective=goals)
    names, moments = [term.name for term in goals.terms], picture.moments(None)
    found = {name: at_times(picture, [moment for moment in moments if name in moment.about]) for name in names}
    assert found["two times"] == pytest.approx([0.7, 3.3], abs=0.06)
    assert found["window"] == pytest.approx([1.2, 1.6, 2.0], abs=0.06)
    assert found["sometime"] == pytest.approx([2.5], abs=0.11)  # where the pelvis is at z = 2.5
    times = at_times(picture, moments)
    assert times[0] == 0.0 and times[-1] == 4.0 and times == sorted(times)
    assert np.diff(times).max() < 0.9  # and some between, so that nothing is left out


def test_of_a_script_there_is_a_moment_for_each_act_when_most_of_its_goals_apply(tiny: ModuleType) -> None:
    motion = moving(tiny, [(0, 0), (0, 2), (0, 4)])
    near = {"joint": "pelvis", "position": [0.0, 1.3]}
    goals = Objective(
        (
            Term("joint_target", near, window=[0.0, 1.5], tolerance=99.0, name="all along"),
            Term("joint_target", near, window=[1.1, 1.3], tolerance=99.0, name="at its end"),
            Term("joint_target", near, at=3.5, name="missed"),
        )
    )
    acts = [Shown("1 walk", 0.0, 1.5), Shown("2 stand", 1.5, 2.5), Shown("3 wave", 2.5, 4.0)]
    moments = judged(Picture(Scene.empty(), motion, objective=goals, acts=acts)).moments(None)
    found = {moment.about: motion.times[moment.frame].item() for moment in moments if moment.about}
    assert found[("1 walk",)] == pytest.approx(1.2, abs=0.06)
    assert found[("2 stand",)] == pytest.approx(2.0, abs=0.06)
    assert found[("missed", "3 wave")] == pytest.approx(3.5, abs=0.06)  # of its goals those that are missed
    assert len(found) == 3


def test_the_worst_moment_of_a_goal_about_all_of_a_motion_is_shown(tiny: ModuleType) -> None:
    """A person who walks through a box: the deepest frame is one of those drawn, and said to be."""
    motion = moving(tiny, [(0, 0), (0, 2)])
    scene = Scene(primitives=[Box((0.15, 0.9, 1.05), (0.3, 0.2, 0.1))])
    goals = Objective((Term("sdf_penetration", {}),))
    picture = judged(Picture(scene, motion, objective=goals))
    (report,) = picture.reports
    assert not report.met and report.when is not None
    (moment,) = [m for m in picture.moments(None) if m.about]
    assert picture.time(moment.frame) == pytest.approx(report.when, abs=1e-6)
    assert "sdf_penetration" in picture.told(moment)


def test_what_is_not_believable_is_shown_first(tiny: ModuleType) -> None:
    motion = moving(tiny, [(0, 0), (0.1, 0)])
    findings = (
        Finding("speed", 9.0, 3.0, "m/s", "the pelvis makes 9 m/s at 1.30 s", at_s=1.3),
        Finding("bones", 0.2, 0.06, "m", "the left forearm is 20 cm short"),
        Finding("support", 0.4, 0.2, "s", "nothing holds the body at 0.40 s", at_s=0.4),
    )
    picture = Picture(Scene(primitives=[Box((1, 0.5, 0), (0.2, 1, 0.2))]), motion, verdict=Verdict(findings))
    moments = picture.moments(None)
    assert {round(picture.time(m.frame), 2): m.about for m in moments if m.about} == {
        1.3: ("speed",),
        0.4: ("support",),
    }
    plan = planned(picture, moments, SIZE)
    assert at_times(picture, plan.shown) == [1.3]  # all stand at one place: the worst is the one in the scene
    late = replace(picture, verdict=Verdict((replace(findings[0], at_s=99.0),)))
    assert at_times(late, [m for m in late.moments(None) if m.about]) == [2.0]  # clipped, never an error


def test_people_who_stay_in_place_are_beside_each_other(tiny: ModuleType) -> None:
    stays = Picture(Scene.empty(), moving(tiny, [(0, 0), (0.05, 0), (0, 0)]))
    plan = planned(stays, stays.moments(None), SIZE)
    assert plan.scene[1] == 0 and len(plan.beside) == len(stays.moments(None)) >= 5  # there is no scene to show
    walks = Picture(Scene.empty(), moving(tiny, [(0, 0), (0, 3)]))
    plan = planned(walks, walks.moments(None), SIZE)
    assert not plan.beside and plan.scene == SIZE and len(plan.shown) >= 5
    box = Scene(primitives=[Box((1.5, 0.5, 0), (0.2, 1, 0.2))])
    both = Picture(box, moving(tiny, [(0, 0), (0, 3), (0, 3), (0, 3)]))
    plan = planned(both, both.moments(None), SIZE)
    assert min(at_times(both, plan.beside)) >= 1.5 and len(plan.beside) >= 4
    assert min(at_times(both, plan.shown)) == 0.0 and len(plan.shown) >= 4
    assert plan.scene[1] + plan.row[1] == SIZE[1]


def test_no_two_people_in_the_scene_overlap(tiny: ModuleType) -> None:
    for way in ([(0, 0), (0, 2.5)], [(0, 0), (0.3, 0.2), (0, 1)], [(0, 0), (0, 2), (0, 0)]):
        picture = Picture(Scene(primitives=[Box((2, 0.5, 0), (0.2, 1, 0.2))]), moving(tiny, way))
        plan = planned(picture, picture.moments(None), SIZE)
        masks = []
        for moment in plan.shown:
            pixels, scale = plan.camera.project(picture.surface(moment.frame), plan.scene)
            masks.append(spots(pixels, DEFAULT_BODY.radii().numpy() * scale, plan.scene))
        for a, b in combinations(masks, 2):
            assert (a & b).sum() < 0.2 * min(a.sum(), b.sum())


def test_cameras_project_as_the_stage_draws() -> None:
    camera = Camera(np.array([3.0, 2.0, 4.0]), np.array([0.2, 1.0, -0.1]))
    points = np.array([[0.0, 1.0, 0.0], [0.5, 0.2, 0.3], [-0.4, 1.7, 0.5]])
    pixels, scale = camera.project(points, SIZE)
    from scenectl.view.camera import look_from

    stage = open_stage(SIZE)
    look_from(stage, camera)
    stage.render()
    for point, pixel in zip(points, pixels, strict=True):
        stage.renderer.SetWorldPoint(*point, 1.0)
        stage.renderer.WorldToDisplay()
        x, y, _ = stage.renderer.GetDisplayPoint()
        assert pixel == pytest.approx((x, SIZE[1] - y), abs=1.0)
    beside, _ = camera.project(points + 0.01 * np.cross([0, 1, 0], camera.position - camera.target) / 4.7, SIZE)
    assert np.linalg.norm(beside - pixels, axis=1) == pytest.approx(0.01 * scale, rel=0.1)
    stage.close()
    assert np.isnan(camera.project(camera.position[None] * 2, SIZE)[1]).all()  # behind it


# ---- everyone is seen ---------------------------------------------------------------------------------------------


def seen_shares(picture: Picture, size: tuple[int, int] = (480, 300)) -> list[float]:
    """Of each person in the scene, how much of what would be seen of them without the scene is seen."""
    plan = planned(picture, picture.moments(None), size)
    frames, stage = [moment.frame for moment in plan.shown], open_stage(plan.scene)
    stage.disable_anti_aliasing()
    picture.set_stage(stage, plan.camera, frames, False)
    picture.draw_moving(stage, [picture.time(frame) for frame in frames])
    picture.draw_people(stage, frames, False)
    others = [actor for name, actor in stage.actors.items() if not name.startswith("person")]
    for k in range(len(frames)):
        actor = stage.actors[f"person {k}"]
        actor.prop.lighting, actor.prop.color = False, [c / 255 for c in IDS[k]]
    counts = []
    for hidden in ([actor for actor in others if actor.prop.opacity < 1], others):  # glass is looked through
        for actor in hidden:
            actor.visibility = False
        image = np.asarray(stage.screenshot(return_img=True)).astype(int)
        counts.append([int((np.abs(image - np.array(IDS[k])).max(axis=-1) <= 3).sum()) for k in range(len(frames))])
    stage.close()
    assert min(counts[1]) > 20
    return [seen / most for seen, most in zip(*counts, strict=True)]


def rough(box: Box, parts: int = 4) -> Mesh:
    """A box as a scan would have it: many triangles that lie in no plane."""
    import trimesh

    mesh = trimesh.Trimesh(box.mesh().vertices, box.mesh().faces)
    for _ in range(parts):
        mesh = mesh.subdivide()
    jitter = 0.02 * np.random.default_rng(0).standard_normal(mesh.vertices.shape)
    return Mesh(mesh.vertices + jitter, mesh.faces)


def shell(thick: float = 0.1) -> Mesh:
    """A closed room of 3 m x 2.5 m x 4 m with walls, floor and ceiling of a thickness (m), in one mesh."""
    inner, outer = Box((0, 1.25, 1), (3, 2.5, 4)).mesh(), Box((0, 1.25, 1), (3 + thick, 2.5 + thick, 4 + thick)).mesh()
    faces = np.concatenate([inner.faces[:, ::-1], outer.faces + len(inner.vertices)])
    return Mesh(np.concatenate([inner.vertices, outer.vertices]), faces)


def near_furniture() -> Scene:
    walls = [Box((s * 0.8, 1.3, 1), (0.1, 2.6, 5)) for s in (-1, 1)]
    things = [Box((0.45, 0.45, 0.5), (0.3, 0.9, 1.6)), Box((-0.45, 0.9, 2.0), (0.25, 1.8, 0.8)), *walls]
    return Scene(primitives=[*things, Box((0, 1.3, -1.5), (1.5, 2.6, 0.1)), Box((0, 1.3, 3.4), (1.5, 2.6, 0.1))])


ROOMS: dict[str, Callable[[], Scene]] = {
    "a closed room": lambda: Scene([shell()], resolution=24, cache=None),
    "a room with rough walls": lambda: Scene(
        [rough(Box((s * 0.9, 1.2, 1), (0.2, 2.4, 5))) for s in (-1, 1)], resolution=24, cache=None
    ),
    "furniture near on both sides": near_furniture,
    "a wall across": lambda: Scene(primitives=[Box((0.9, 1.0, 1.0), (0.1, 2.0, 6.0)), Box((-0.9, 1, 1), (0.1, 2, 6))]),
    "an alcove": lambda: Scene(primitives=[Box((x, 1, z), (0.1, 2, 1)) for x in (-0.6, 0.6) for z in (0, 1, 2)]),
}


@pytest.mark.parametrize("room", ROOMS)
def test_everyone_who_is_drawn_is_seen(room: str, tiny: ModuleType) -> None:
    scene = ROOMS[room]()
    for way in ([(0, -0.4), (0, 2.4)], [(0, 1), (0.02, 1)]):
        assert min(seen_shares(Picture(scene, moving(tiny, way)))) > 0.7


@pytest.mark.parametrize(
    ("name", "ways"),
    [
        ("living_room", [[(-1.95, -1.9), (-0.8, 1.4)]]),
        ("doorway", [[(0.8, -2.2), (0.0, 0.0), (0.6, 2.0)]]),
        ("corridor", [[(0.0, -2.5), (0.0, 2.0)]]),
        ("pillars", [[(0.0, -3.3), (0.7, -1.6), (-0.7, 0.0)], [(0.8, -2.4), (0.8, 1.6)]]),
    ],
)
def test_everyone_is_seen_in_the_bundled_rooms(
    name: str, ways: list[list[tuple[float, float]]], tiny: ModuleType
) -> None:
    scene = bundled(name)
    for way in ways:
        assert min(seen_shares(Picture(scene, moving(tiny, way)))) > 0.7


@pytest.mark.parametrize(
    ("file", "way"),
    [
        ("data/meshes/living_room.ply", [(-0.6, -0.4), (1.0, 1.0)]),
        ("data/meshes/office_large.ply", [(-0.4, 0.4), (0.6, 1.0)]),
        ("cases/tasks/flat.glb", [(1.0, 1.2), (-0.5, 1.0), (-3.0, -1.0)]),
        ("cases/tasks/corridor.glb", [(-3.0, 0.0), (3.0, 0.1)]),
    ],
)
def test_everyone_is_seen_in_scans_and_flats(
    file: str, way: list[tuple[float, float]], tiny: ModuleType, shared: Path
) -> None:
    picture = Picture(named_scene(str(shared / file)), moving(tiny, way))
    assert min(seen_shares(picture)) > 0.7


# ---- what is written ----------------------------------------------------------------------------------------------


@given(
    st.lists(st.tuples(st.floats(0, 640), st.floats(0, 400), st.text("aw \n", min_size=1, max_size=40)), max_size=14),
    st.integers(8, 24),
)
@settings(max_examples=40, deadline=None)
def test_labels_neither_overlap_nor_leave_the_picture(at: list[tuple[float, float, str]], height: int) -> None:
    from PIL import Image

    image, busy = Image.new("RGB", SIZE), np.zeros((SIZE[1] // COARSE, SIZE[0] // COARSE), dtype=bool)
    boxes = draw_labels(image, [Label(text, (x, y)) for x, y, text in at], busy, height)
    assert len(boxes) >= min(len(at), 3)
    for left, top, right, bottom in boxes:
        assert 0 <= left < right <= SIZE[0] and 0 <= top < bottom <= SIZE[1]
    for a, b in combinations(boxes, 2):
        assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]


def test_labels_keep_off_people() -> None:
    from PIL import Image

    busy = spots(np.array([[320.0, 200.0]]), np.array([60.0]), SIZE)
    assert busy.mean() == pytest.approx(np.pi * 60**2 / (SIZE[0] * SIZE[1]), rel=0.1)
    (box,) = draw_labels(Image.new("RGB", SIZE), [Label("1.2 s", (320.0, 200.0))], busy, 14)
    assert max(abs((box[0] + box[2]) / 2 - 320), abs((box[1] + box[3]) / 2 - 200)) > 55


@given(st.text(max_size=80), st.floats(0, 400))
@settings(max_examples=60, deadline=None)
def test_writing_is_plain_and_cut_to_fit(text: str, width: float) -> None:
    words, type_ = plain(text), font(16)
    assert words.isprintable() and plain(words) == words
    line = cut(words, width, type_)
    assert type_.getlength(line) <= max(width, type_.getlength("…"))
    assert line == words or line.endswith("…")
    assert len(short(text)) <= LONG


def test_captions_say_what_is_met_and_believed(tiny: ModuleType) -> None:
    goals = Objective(
        (
            Term("joint_target", {"joint": "pelvis", "position": [0.0, 2.0]}, at=2.0, name="there"),
            Term(
                "joint_target", {"joint": "pelvis", "position": [1.0, 0.0]}, at=0.0, name="[/b] $x^2$ " + 99 * "long "
            ),
        )
    )
    picture = judged(Picture(Scene.empty(), moving(tiny, [(0, 0), (0, 2)]), objective=goals))
    wrong = Verdict((Finding("speed", 9.0, 3.0, "m/s", "the pelvis makes 9 m/s at 1.30 s", at_s=1.3),))

    def words(caption: Caption) -> list[str]:
        return ["".join(run.text for run in line) for line in caption.lines]

    asked, met, goals_told = words(Caption("walk\x1b[31m \n on", picture.reports, wrong, (1600, 1000)))
    assert asked == "walk [31m on"
    assert met == "met 1 of 2 · not believable: the pelvis makes 9 m/s at 1.30 s"
    missed, there = goals_told.split("   ")  # what is missed comes first
    assert missed.startswith("[/b] $x^2$ long") and "…: missed, 1 of 0.05 m" in missed
    assert there == told(picture.reports[0]) == "there: met, 0 m"
    assert "believable" in words(Caption("a", picture.reports, Verdict(), (1600, 1000)))[1]
    assert not words(Caption("", (), None, (1600, 1000)))
    many = 60 * list(picture.reports)
    for size in ((1600, 1000), (320, 200), (90, 60)):
        caption = Caption("a " * 900, many, wrong, size)
        assert len(caption.lines) <= 6 and caption.letters == letters(size)
        for line in caption.lines:
            assert font(caption.letters).getlength("".join(run.text for run in line)) <= size[0]


def test_results_show_what_their_reports_say(tiny: ModuleType, tmp_path: Path) -> None:
    """Of a result at hand and of the folder it was saved to; reports of before the verdict have none."""
    goals = (Term("joint_target", {"joint": "pelvis", "position": [0.0, 9.0]}, at=2.0),)
    result = run(Task(prompt="walk", seconds=3.0, goals=goals, avoid=False), 1, generator=tiny.TinyGenerator())
    row = result.report["samples"][0]
    finding = Finding("speed", 9.0, 3.0, "m/s", "the pelvis makes 9 m/s at 1.30 s", at_s=1.3)
    row["verdict"] = Verdict((finding,)).as_dict()
    row["terms"][0]["cost"] = None  # what was not a number
    result.save(tmp_path, preview=False)
    for picture in (of_result(result), of_folder(tmp_path)):
        assert picture.verdict is not None and picture.verdict.findings == (finding,)
        (report,) = picture.reports
        assert report == replace(result.samples[0].terms[0], cost=float("inf"), series=())
        assert {about for moment in picture.moments(None) for about in moment.about} == {"speed", report.name}
    del row["verdict"]
    assert of_result(result).verdict is None


def test_users_words_are_drawn_as_they_are(tiny: ModuleType, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    goals = Objective((Term("head_height", {"height": [1.5, 1.0, 1.5]}, name="$\\frac{1}{0$ [red] \ud800 \N{SNAKE}"),))
    picture = Picture(Scene.empty(), moving(tiny, [(0, 0), (0, 0.1)]), objective=goals, title="$\\bad{$ \x00 [/b]")
    judged(picture).draw(tmp_path / "a.png", size=SIZE)
    assert (tmp_path / "a.png").stat().st_size > 3000
    assert not capfd.readouterr().err


# ---- textures -----------------------------------------------------------------------------------------------------


def textured(path: Path, pixels: int) -> Path:
    """A box whose left half is blue and right half red, by a picture of so many pixels a side."""
    import trimesh
    from PIL import Image

    picture = Image.new("RGB", (pixels, pixels), (200, 30, 30))
    picture.paste((30, 30, 200), (0, 0, pixels // 2, pixels))
    mesh = trimesh.creation.box((2, 1, 2))
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=picture, baseColorFactor=[0, 128, 0, 255])
    mesh.visual = trimesh.visual.TextureVisuals(uv=(mesh.vertices[:, :2] + 1) / 2, material=material)
    trimesh.Scene(mesh).export(path)
    return path


def test_large_textures_are_shrunk_and_huge_ones_not_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small = face_colours(load_mesh(textured(tmp_path / "small.glb", 32)))
    assert {tuple(colour) for colour in small} >= {(30, 30, 200), (200, 30, 30)}
    large = face_colours(load_mesh(textured(tmp_path / "large.glb", 3000)))
    assert np.abs(large.astype(int) - small).max() <= 2
    monkeypatch.setattr("scenes.mesh.colours._PIXELS", 10**6)
    decoded: list[object] = []
    monkeypatch.setattr("PIL.PngImagePlugin.PngImageFile.load", lambda self: decoded.append(self))
    huge = face_colours(load_mesh(tmp_path / "large.glb"))
    assert not decoded and (huge[:, 1] > huge[:, 0]).all() and len(np.unique(huge, axis=0)) == 1  # the material's green
