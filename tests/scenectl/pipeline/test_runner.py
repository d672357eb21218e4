"""From a task to files, with a generator that needs no weights."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import torch

import scenectl as sc
from objectives import Objective, Term, forget
from scenectl.control import SolverSettings
from scenectl.measures.metrics import Scorer
from scenectl.pipeline.rank import ranked
from scenectl.pipeline.results import Result, load_result
from scenectl.pipeline.run import run, score
from scenectl.pipeline.tables import FORMAT
from scenectl.tasks.code import allow_code
from scenes.errors import UserError
from scenes.mesh.primitives import Box
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.skeleton import HUMANML3D
from scenes.world.scene import Scene
from tests.scenectl.small import walk

TASK = """
prompt = "a statue slides"
seconds = 3.0
start = { position = [1.0, -1.0], heading = 1.5708 }
samples = 3
seed = 4

[[scene.primitives]]
shape = "box"
center = [3.5, 1.0, -1.0]
size = [0.4, 2.0, 0.4]

[[goal]]
use = "joint_target"
joint = "pelvis"
position = [2.0, -1.2]
at = 2.9
"""


@pytest.fixture
def task_file(tmp_path: Path) -> Path:
    path = tmp_path / "task.toml"
    path.write_text(TASK)
    return path


def test_run_refines_ranks_and_reports(task_file: Path, tiny: ModuleType) -> None:
    said: list[str] = []
    result = run(sc.load_task(task_file), generator=tiny.TinyGenerator(), progress=lambda what, done: said.append(what))
    assert result.motion.joints.shape == (3, 60, 22, 3)
    costs = [sample.cost for sample in result.samples]
    assert costs == sorted(costs)
    end = result.motion.joint("pelvis")[0, 58, [0, 2]]
    assert end.tolist() == pytest.approx([2.0, -1.2], abs=0.05)
    assert result.samples[0].met
    assert result.samples[0].unrefined_cost is not None and result.samples[0].unrefined_cost > costs[0]
    assert {"measuring", "refinement"} <= set(said)
    report = result.report
    assert report["generator"]["licence"] == "CC0-1.0" and report["generator"]["weights"] is None  # one handed in
    assert report["generator"]["trace"]["nan"] is None
    assert report["refinement"]["solver"] in ("lm", "gauss_newton", "lbfgs") and report["refinement"]["passes"] > 0
    assert len(report["refinement"]["ended"]) == len(report["samples"])
    assert report["body"]["source"].startswith("mean of women and men in ANSUR II")
    assert len(report["body"]["radii"]) > 40
    assert report["seed"] == 4
    assert report["samples"][0]["terms"][0]["met"] is True
    assert report["samples"][0]["metrics"]["skating_ratio"] >= 0.0


def test_of_samples_that_meet_all_goals_the_least_changed_comes_first(task_file: Path, tiny: ModuleType) -> None:
    problem = sc.load_task(task_file).build(4)
    problem = replace(problem, objective=Objective((Term("square_region", {"half": 99.0}),)))
    before = Motion(walk(60).repeat(3, 1, 1, 1))
    after = before.joints.clone()
    for i, change in enumerate((0.2, 0.0, 0.1)):
        after[i, :, 20] += change  # a wrist
    after[1] += torch.tensor([0.5, 0.0, 0.3])  # elsewhere, in the same poses
    _, rows = ranked(Motion(after), before, problem, Scorer(problem.scene), lambda what, done: None)
    assert [row.index for row in rows] == [1, 2, 0] and all(row.met for row in rows)
    assert rows[0].pose_change == pytest.approx(0.0, abs=1e-6)


def test_samples_come_in_the_order_of_their_cost(task_file: Path, tiny: ModuleType) -> None:
    free = sc.load_task(task_file).model_copy(update={"solver": SolverSettings(iterations=0)})
    result = run(free, 8, 1, tiny.TinyGenerator())
    problem = result.setup
    costs = problem.objective.cost(result.motion, problem.context).tolist()
    assert costs == sorted(costs) and len(set(costs)) == 8
    assert [sample.cost for sample in result.samples] == pytest.approx(costs)
    assert [sample.index for sample in result.samples] != list(range(8))


def test_a_sample_that_meets_all_goals_comes_before_a_cheaper_one_that_does_not(tiny: ModuleType) -> None:
    task = sc.Task(
        prompt="walks", seconds=2.0, avoid=False,
        goals=[
            sc.Term("joint_target", {"position": [0.0, 0.0]}, at=1.0, weight=100.0, tolerance=0.5, name="loose"),
            sc.Term("joint_target", {"joint": "head", "position": [0.0, 0.0]}, at=1.9, weight=0.01, tolerance=0.4),
        ],
    )  # fmt: skip
    one = tiny.TinyGenerator().generate("walks", 2.0, Pose2D()).motion
    still = one.joints[:, :1].expand_as(one.joints)
    still = still - still[:, :, :1] * torch.tensor([1.0, 0.0, 1.0])
    head = still.clone()
    head[:, 38, HUMANML3D.index("head")] += torch.tensor([1.0, 0.0, 0.0])  # cheap, and not met
    off = still + torch.tensor([0.05, 0.0, 0.0])  # dearer, and met
    result = score(replace(one, joints=torch.cat([head, off]), valid=one.valid.expand(2, -1)), task)
    assert [sample.met for sample in result.samples] == [True, False]
    assert result.samples[0].cost > result.samples[1].cost


def test_same_seed_same_motion(task_file: Path, tiny: ModuleType) -> None:
    task = sc.load_task(task_file)
    first, same, other = (run(task, 1, seed, tiny.TinyGenerator()).motion.joints for seed in (7, 7, 8))
    assert np.array_equal(first, same)
    assert not np.array_equal(first, other)


def test_files_hold_what_was_made(task_file: Path, tiny: ModuleType, tmp_path: Path) -> None:
    result = run(sc.load_task(task_file), generator=tiny.TinyGenerator())
    folder = result.save(tmp_path / "out", preview=False)
    motion, report = load_result(folder)
    assert np.array_equal(motion.joints, result.motion.joints)
    with np.load(folder / "motion.npz", allow_pickle=False) as data:
        assert int(data["seed"]) == 4
        assert str(data["unit"]) == "m" and str(data["licence"]) == "CC0-1.0"
        assert float(data["fps"]) == 20.0
        assert list(data["joint_names"])[:2] == ["pelvis", "left_hip"]
    assert report["format"] == FORMAT
    assert report == json.loads(json.dumps(result.report))
    again = score(motion, sc.load_task(task_file))
    assert [s.cost for s in again.samples] == pytest.approx([s.cost for s in result.samples], rel=1e-4)


def test_cli_runs_scores_and_draws(
    task_file: Path, tiny_generator: None, scenectl: Callable[..., object], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    said = scenectl("run", task_file, "-o", out, "--samples", 2, "--allow-unmet")
    assert said.status == 0, said.err
    assert {path.name for path in out.iterdir()} == {"motion.npz", "report.json", "preview.png"}
    assert "joint_target: met" in said.out
    said = scenectl("score", out, task_file, "--json", tmp_path / "score.json", "--allow-unmet")
    assert said.status == 0 and "joint_target: met" in said.out
    assert json.loads((tmp_path / "score.json").read_text())["samples"]
    said = scenectl("view", out, "--png", tmp_path / "view.png", "--sample", 1, "--slice", "--clearance")
    assert said.status == 0 and (tmp_path / "view.png").stat().st_size > 10_000
    said = scenectl("view", out, "--png", tmp_path / "view.png", "--sample", 5)
    assert said.status == 2 and "--sample goes from 0 to 1" in said.err


def test_a_motion_without_a_valid_frame_is_refused(
    task_file: Path, tiny: ModuleType, scenectl: Callable[..., object], tmp_path: Path
) -> None:
    made = Motion(tiny.statue().expand(2, 60, 22, 3).clone())
    for valid in (torch.zeros(2, 60), torch.tensor([[1.0], [0.0]]).expand(2, 60)):
        replace(made, valid=valid.bool()).save(tmp_path / "motion.npz")
        said = scenectl("score", tmp_path / "motion.npz", task_file)
        assert said.status == 2 and "valid" in said.err and len(said.err.strip().splitlines()) == 1
        with pytest.raises(UserError, match="no frame is valid"):
            score(replace(made, valid=valid.bool()), sc.load_task(task_file))


def test_task_files_run_no_code_unless_allowed(
    tmp_path: Path, tiny_generator: None, scenectl: Callable[..., object]
) -> None:
    (tmp_path / "mine.py").write_text(
        "from objectives import goal\n\n\n@goal(unit='m')\ndef stay_low(motion, context, *, limit: float):\n"
        "    'Stay low.'\n    return (motion.joint('head')[..., 1:2] - limit).clamp_min(0)\n"
    )
    task = tmp_path / "task.toml"
    task.write_text('prompt = "x"\nseconds = 2.0\n[[goal]]\nuse = "stay_low"\nlimit = 2.5\n')
    assert scenectl("check", task).status == 2
    try:
        assert scenectl("check", task, "--allow-code", tmp_path / "mine.py").status == 0
    finally:
        forget("stay_low")
    (tmp_path / "broken.py").write_text("1 / 0\n")
    with pytest.raises(UserError, match=r"broken\.py.*ZeroDivisionError"):
        allow_code(tmp_path / "broken.py")


def test_bench_reuses_what_was_prepared(tiny: ModuleType) -> None:
    scene = Scene(primitives=[Box((0.0, 1.0, 3.0), (1.0, 2.0, 0.4))], floor=0.0)
    task = sc.Task(prompt="x", seconds=4.0, scene=scene, start=[0.0, 0.0], walk={"to": [0.0, 1.5]})
    problem = task.build()
    result = run(task, 1, 0, tiny.TinyGenerator(), setup=problem)
    assert result.setup is problem
    assert isinstance(result.motion, Motion)
    assert result.samples[0].terms[0].name == "walk: path"


def _room() -> Scene:
    """2.4 x 2.4 m, walls of 4 cm, no ceiling, on open ground."""
    walls = [Box((s * 1.22, 1.2, 0.0), (0.04, 2.4, 2.48)) for s in (-1, 1)]
    return Scene(primitives=[*walls, *(Box((0.0, 1.2, s * 1.22), (2.4, 2.4, 0.04)) for s in (-1, 1))])


def test_who_would_walk_out_through_a_wall_is_pulled_back(tiny: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """Statues whose draft ends 1.4 m outside stay in the room, whatever pulls at them from there."""
    pulled = {"use": "joint_target", "joint": "pelvis", "position": [0.0, 2.6], "at": 4.9, "weight": 1.0}
    walls = {"use": "sdf_penetration", "margin": 0.03, "kernel": "squared", "reduction": "sum", "weight": 300.0}

    def made(*goals: dict[str, object]) -> Result:
        given = {"prompt": "a statue slides", "seconds": 5.0, "start": [0.0, 0.0], "samples": 4}
        return run(sc.Task(**given, scene=_room(), goals=goals), generator=tiny.TinyGenerator())

    alone, drawn = made(walls), made(walls, pulled)
    assert all(row.met and row.metrics["beyond_free_space_m"] == 0.0 for row in alone.samples)
    assert alone.report["scene"]["doubts"] == []
    assert not any(row.met for row in drawn.samples)
    for found in (alone, drawn):  # within a sample's radius of the wall, but no farther
        assert float(found.motion.joint("pelvis")[..., 2].max()) < 1.2
    (doubt,) = drawn.report["scene"]["doubts"]
    assert "target [0.00, 2.60] of pelvis lies 1.4" in doubt and "outside of the free space" in doubt
    monkeypatch.setattr(Scene, "reached_from", lambda scene, place: scene)
    assert float(made(walls).motion.joint("pelvis")[..., -1, 2].max()) > 1.3, "without it they leave"


def test_motions_that_begin_in_walls_or_over_nothing_are_scored_and_that_is_said() -> None:
    statue = Motion(walk(40, speed=0.0))
    task = sc.Task(prompt="a statue stands", seconds=2.0, scene=_room(), goals=[{"use": "sdf_penetration"}])
    assert score(statue, task).report["scene"]["doubts"] == []
    stuck = statue.placed(Pose2D((1.22, 0.0, 0.0)))
    assert "lies in a solid" in score(stuck, task).report["scene"]["doubts"][0]
