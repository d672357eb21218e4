"""Task files: what they mean, what is wrong with them, and that they are data."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from objectives import Term
from scenectl.generators.mscot.settings import SPEC
from scenectl.tasks.schema import SceneSpec
from scenectl.tasks.setup import heading_along, start_of
from scenectl.tasks.task import Task, load_task
from scenectl.tasks.walk import PACE, Walk
from scenes.body.body import DEFAULT_BODY
from scenes.errors import UserError
from scenes.mesh.mesh import load_mesh
from scenes.mesh.primitives import Box, Sphere
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.waypoints import Waypoints
from scenes.world.floor.polyline import path_length
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import Scene, bundled, load_scene

EXAMPLES = sorted((Path(__file__).resolve().parents[3] / "examples" / "tasks").glob("*.toml"))
WALL = Scene(primitives=[Box((0.0, 1.0, 2.0), (2.0, 2.0, 0.2))], floor=0.0)


def coarse(task: Task) -> Task:
    """The same task on a grid that bakes in a moment."""
    assert isinstance(task.scene, SceneSpec)
    return task.model_copy(update={"scene": task.scene.model_copy(update={"resolution": 72})})


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_are_valid(path: Path) -> None:
    problem = coarse(load_task(path)).build()
    assert problem.objective.counted
    walks = "[walk]" in path.read_text() or any(f'do = "{do}"' in path.read_text() for do in ("walk", "climb", "carry"))
    assert (problem.path is not None) == walks


def test_there_are_enough_examples() -> None:
    assert len(EXAMPLES) >= 9


def test_paths_resolve_beside_the_file(tmp_path: Path) -> None:
    (tmp_path / "room").mkdir()
    import trimesh

    trimesh.creation.box(extents=(1.0, 2.0, 1.0)).export(tmp_path / "room" / "box.ply")
    np.save(tmp_path / "track.npy", np.tile([0.0, 1.0, 1.0], (20, 1)))
    task = tmp_path / "task.toml"
    task.write_text(
        'prompt = "x"\nseconds = 3.0\n[scene]\nfile = "room/box.ply"\nfloor = -1.0\n[[goal]]\nuse = "joint_target"\n'
        'track = { kind = "array", file = "track.npy" }\n'
    )
    loaded = load_task(task)
    assert isinstance(loaded.scene, SceneSpec)
    assert loaded.scene.file == tmp_path / "room" / "box.ply"
    assert loaded.load_scene().floor.height == -1.0


def test_walk_becomes_a_path_and_a_target() -> None:
    task = Task(prompt="x", seconds=6.0, scene=WALL, start={"position": [0.0, 0.0]}, walk={"to": [0.0, 4.0]})
    problem = task.build()
    assert problem.path is not None
    assert path_length(problem.path) > 4.3  # around the wall, not through it
    assert [term.goal for term in problem.objective.terms[:2]] == ["follow_path", "joint_target"]
    assert [term.goal for term in problem.objective.terms[-2:]] == ["sdf_penetration", "foot_contact"]
    assert problem.objective.terms[1].parameters["position"] == (0.0, 4.0)
    assert problem.start.heading == pytest.approx(heading_along(problem.path))
    assert abs(problem.start.heading) > 0.2  # it looks where it goes
    assert problem.start.position[1] == pytest.approx(DEFAULT_BODY.sole_offset)


def test_walk_passes_its_stops() -> None:
    walk = Walk(to=(0.0, 4.0), via=((1.5, 2.0),))
    problem = Task(prompt="x", scene=WALL, start=[0.0, 0.0], walk=walk).build()
    assert problem.path is not None
    assert np.linalg.norm(problem.path[:, [0, 2]] - [1.5, 2.0], axis=1).min() < 0.05


def test_a_walk_across_a_large_place_takes_as_long_as_it_takes() -> None:
    far = Task(prompt="x", scene=Scene.empty(), start=[0.0, -15.0], walk={"to": [0.0, 15.0]}).build()
    assert SPEC.window < far.seconds == pytest.approx(30.0 / PACE, abs=1.0)
    there_and_back = {"to": [0.0, 18.0], "via": [[0.0, 18.0 * (-1) ** i] for i in range(1, 8)]}
    with pytest.raises(UserError, match="give a nearer target"):
        Task(prompt="x", scene=Scene.empty(), start=[0.0, 0.0], walk=there_and_back).build()


def test_sampled_starts_follow_the_seed_and_reach_the_target() -> None:
    task = Task(prompt="x", seconds=6.0, scene=WALL, start="sample", walk={"to": [0.0, 1.0]})
    first, same, other = task.build(1).start, task.build(1).start, task.build(2).start
    assert first == same != other
    assert float(WALL.distance_exact(np.array([[first.position[0], 1.0, first.position[2]]]))[0]) > 0.25


def test_a_finished_motion_says_where_it_started(tiny: object) -> None:
    joints = tiny.statue().expand(5, 22, 3).clone()  # type: ignore[attr-defined]
    for heading in (-2.5, 0.0, 1.2, math.pi / 2):
        pose = Pose2D((1.0, 0.3, -2.0), heading)
        found = start_of(Motion(pose.apply(joints)))
        assert found.heading == pytest.approx(heading, abs=1e-4)
        assert (found.position[0], found.position[2]) == pytest.approx((1.0, -2.0), abs=1e-5)


def test_dump_builds_the_same_task(tmp_path: Path) -> None:
    shapes = [{"shape": "sphere", "center": [2.0, 1.0, 0.0], "radius": 0.3}]
    task = Task(
        prompt="x", seconds=3.0, scene={"primitives": shapes}, start={"position": [0, 0]}, samples=3,
        goals=[Term("joint_target", {"joint": "head", "position": [0.0, 1.5, 0.5]}, weight=2.0, at=1.0)],
    )  # fmt: skip
    again = Task(**task.dump())
    assert again.dump() == task.dump()
    assert again.terms[0].parameters == task.terms[0].parameters
    assert again.terms[0].times == (1.0,)
    assert isinstance(again.load_scene().primitives[0], Sphere)


def test_scenes_from_python_are_written_down(tmp_path: Path) -> None:
    import trimesh

    trimesh.creation.box(extents=(100.0, 200.0, 100.0)).export(tmp_path / "box.ply")
    ball = Sphere((2.0, 1.0, 0.0), 0.3, Waypoints((0.0, 2.0), ((2.0, 1.0, 0.0), (3.0, 1.0, 0.0))))
    for scene in (
        Scene(primitives=[ball], floor=0.5),
        bundled("doorway", primitives=[ball]),
        load_scene(tmp_path / "box.ply", unit="cm", up="z", floor=-0.01, primitives=[ball]),
    ):
        again = Task(**Task(prompt="x", seconds=3.0, scene=scene).dump()).load_scene()
        assert again.digest == scene.digest


def test_objects_of_a_file(tmp_path: Path) -> None:
    import trimesh

    trimesh.creation.box(extents=(50.0, 100.0, 20.0)).export(tmp_path / "box.stl")
    task = tmp_path / "task.toml"
    task.write_text(
        'prompt = "x"\nseconds = 3.0\n[[scene.objects]]\nmesh = "box.stl"\nunit = "cm"\nup = "z"\n'
        "times = [0, 1.0]\npositions = [[2, 0, 0], [2, 0, 1]]\nheadings = [0, 1.5]\nresolution = 32\n"
        '[[scene.objects]]\nname = "gate"\nprimitive = { shape = "box", center = [0, 1, 0], size = [1, 2, 0.1] }\n'
        "times = [0]\npositions = [[0, 0, 3]]\nquaternions = [[0, 0, 1, 0]]\n"
    )
    loaded = load_task(task)
    scene = loaded.load_scene()
    box, gate = scene.objects
    way = Trajectory((0.0, 1.0), ((2, 0, 0), (2, 0, 1)), headings=(0, 1.5))
    assert box.trajectory == way and box.resolution == 32
    assert np.ptp(box.solid.bounds, axis=0) == pytest.approx([0.5, 0.2, 1.0])
    assert (box.name, gate.name, scene.name) == ("box", "gate", "objects")
    assert gate.shape == Box((0, 1, 0), (1, 2, 0.1))
    again = Task(**loaded.dump())
    assert again.load_scene().digest == scene.digest and again.dump() == loaded.dump()
    python = Scene(objects=[MovingObject(load_mesh(tmp_path / "box.stl", "cm", "z"), way, resolution=32), gate])
    assert (
        Task(**Task(prompt="x", seconds=3.0, scene=python).dump()).load_scene().digest == python.digest == scene.digest
    )


def test_objects_are_obstacles_to_a_sampled_start(monkeypatch: pytest.MonkeyPatch) -> None:
    def asked(scene: Scene, *_: object) -> None:
        raise UserError(f"asked for the free area around {len(scene.objects)} objects")

    monkeypatch.setattr("scenectl.tasks.setup.free_area", asked)
    thing = MovingObject(Box((0, 0, 0), (1, 1, 1)), Trajectory((0.0,), ((0, 0, 0),)))
    with pytest.raises(UserError, match="around 1 objects"):
        Task(prompt="x", seconds=3.0, scene=Scene(objects=[thing])).build()


def test_an_object_in_no_file_cannot_be_written_down() -> None:
    thing = MovingObject(Box((0, 0, 0), (1, 1, 1)).mesh(), Trajectory((0.0,), ((0, 0, 3),)))
    assert Task(prompt="x", seconds=3.0, scene=Scene(objects=[thing], name="mine")).dump()["scene"] == "mine"


def test_python_tasks_fail_as_files_do() -> None:
    with pytest.raises(UserError, match="did you mean 'seconds'"):
        Task(prompt="x", second=3.0)
    with pytest.raises(UserError, match="lbfgs"):
        Task(prompt="x", seconds=3.0, solver={"name": "lbgfs"})


TIMELINE = """
[[prompt]]
text = "a person walks forward"
end = 3.0
[[prompt]]
text = "a person turns around"
[[prompt]]
text = "a person sits down"
begin = 5.0
end = 9.0
"""


def test_sentences_along_a_motion_have_their_times(tmp_path: Path) -> None:
    (tmp_path / "task.toml").write_text(TIMELINE)
    task = load_task(tmp_path / "task.toml")
    assert task.seconds == 9.0 and not task.build().doubts
    assert [(p.begin, p.end) for p in task.prompts.sentences] == [(0.0, 3.0), (3.0, None), (5.0, 9.0)]
    for same in (Task(prompt=task.prompts), Task(**task.dump()), Task(prompt="x", seconds=9.0).told(task.prompts)):
        assert same.prompts == task.prompts and same.seconds == 9.0
    assert task.told("a person waves").prompt == "a person waves"
    longer = Task(prompt=task.prompts, seconds=12.0)
    assert longer.build().doubts == ("no prompt is about 9 to 12 s, so the nearest one counts there",)


@pytest.mark.parametrize(
    ("prompt", "words"),
    [
        ([], "should be text"),
        ([{"text": "", "end": 3}], "at least 1"),
        ([{"end": 3}], "'text' is missing"),
        ([{"text": "a", "start": 1, "end": 3}], "unknown key 'start'"),
        ([{"text": "a", "end": "soon"}], "a number"),
        ([{"text": "a"}, {"text": "b", "end": 3}], "'b' has no 'begin', and the one before it no 'end'"),
        ([{"text": "a", "end": 2}, {"text": "b", "begin": 1, "end": 3}], "'b' begins at 1 s"),
        ([{"text": "a", "begin": 1}], "'seconds' is missing"),
        ([{"text": "a", "end": float("inf")}], "finite"),
        ([{"text": "a", "end": 121.0}], "to 120 s"),
    ],
)
def test_sentences_that_cannot_be_are_refused(prompt: Any, words: str) -> None:
    with pytest.raises(UserError, match=words):
        Task(prompt=prompt)


def test_a_sentence_after_the_end_is_refused_and_a_string_and_tables_exclude_each_other(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="begins at 5 s, and the motion lasts 4 s"):
        Task(prompt=[{"text": "a"}, {"text": "b", "begin": 5.0}], seconds=4.0).build()
    (tmp_path / "both.toml").write_text('prompt = "a person walks"\n' + TIMELINE)
    with pytest.raises(UserError, match=r"task file '.*both\.toml'"):
        load_task(tmp_path / "both.toml")
