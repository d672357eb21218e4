"""Goals that take clips, in task files: where files are looked for, what is kept, what is wrong."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from jsonschema import Draft202012Validator

from objectives import Objective
from scenectl.export.export import export
from scenectl.generators.mscot.settings import SPEC
from scenectl.tasks.conditions import conditions_of
from scenectl.tasks.json_schema import task_schema
from scenectl.tasks.task import Task, load_task
from scenes.errors import UserError
from scenes.motion.motion import Motion, Pose2D
from tests.objectives.cases import context, standing

HEAD = 'prompt = "x"\nseconds = 3.0\n[[goal]]\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A task's folder with a clip in every format: someone who turns and goes ahead, at 30 frames a second."""
    times = torch.arange(61)[:, None, None] / 30
    clip = Motion(standing(61, dtype=torch.float32) + times * torch.tensor([0.0, 0.0, 1.0]), fps=30.0)
    (tmp_path / "clips").mkdir()
    export(clip, tmp_path / "clips" / "ahead.bvh")
    clip.save(tmp_path / "clips" / "ahead.npz")
    np.save(tmp_path / "clips" / "ahead.npy", clip.joints.numpy())
    return tmp_path


def task(folder: Path, goal: str) -> Task:
    (folder / "task.toml").write_text(HEAD + goal)
    return load_task(folder / "task.toml")


@pytest.mark.parametrize("ending", ["bvh", "npz"])
def test_clips_of_any_kind_lie_beside_the_task(folder: Path, ending: str) -> None:
    loaded = task(
        folder, f'use = "pose"\npose = ["clips/ahead.{ending}#0.5", "clips/ahead.{ending}#1"]\nat = [0.5, 1]\n'
    )
    first, second = loaded.terms[0].parameters["pose"]
    assert second.joints[0, 2] - first.joints[0, 2] == pytest.approx(0.5, abs=1e-4)
    assert np.abs(first.joints - first.joints[0] - (standing(1)[0] - standing(1)[0, 0]).numpy()).max() < 0.02
    again = Task(**json.loads(json.dumps(loaded.dump())))
    assert again.dump() == loaded.dump()
    assert np.array_equal(again.terms[0].parameters["pose"][1].joints, second.joints)
    loaded.build()


def test_what_an_array_does_not_say_is_stated_beside_it(folder: Path) -> None:
    goal = 'use = "like"\nclip = { file = "clips/ahead.npy", fps = 30 }\nframe = "world"\n'
    assert task(folder, goal).terms[0].parameters["clip"].seconds == pytest.approx(2.0)
    with pytest.raises(UserError, match=r"goal 'like': .*frames a second"):
        task(folder, goal.replace(", fps = 30", ""))


def test_data_of_python_are_dumped_and_read_back() -> None:
    clip = Motion(standing(31), fps=15.0)
    own = Task(prompt="x", seconds=3.0, goals=[{"use": "like", "clip": clip}, {"use": "pose", "pose": clip.joints[3]}])
    again = Task(**json.loads(json.dumps(own.dump())))
    assert again.dump() == own.dump() and again.terms[0].parameters["clip"].seconds == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("goal", "said"),
    [
        ('use = "pose"\npose = "clips/ahead.bvh#2.5"\nat = 1', "time 2.5 s lies outside clip"),
        ('use = "pose"\npose = "clips/none.bvh#1"\nat = 1', "does not exist"),
        ('use = "pose"\npose = "task.toml#1"\nat = 1', "ends with '.toml'"),
        ('use = "like"\nclip = "clips/ahead.bvh#1:3"', "time 3 s lies outside clip"),
        ('use = "like"\nclip = "clips"', "does not exist"),
        ('use = "like"\nclip = "clips/ahead.bvh"\njoints = "wrist"', "unknown joint 'wrist'"),
        ('use = "like"\nclip = "clips/ahead.bvh"\ntiming = "free"\nend = 0.5', "goes by in 1.00 to 4.00 s"),
        ('use = "like"\nclip = "clips/ahead.bvh"\nbegin = 4', "lies outside the motion"),
    ],
)
def test_what_is_wrong_names_file_and_goal(folder: Path, goal: str, said: str) -> None:
    use = goal.split('"')[1]
    with pytest.raises(UserError, match=rf"task file '.*task.toml': goal '{use}'.*{said}") as caught:
        task(folder, goal + "\n").build()
    assert "\n" not in str(caught.value)


def test_the_schema_knows_every_way_to_state_a_clip() -> None:
    schema = Draft202012Validator(json.loads(json.dumps(task_schema(), allow_nan=False)))
    pose = [[0.0, 1.0, 0.0]] * 22
    for goal in (
        {"use": "pose", "pose": "a.bvh#1"},
        {"use": "pose", "pose": ["a.bvh#1", "b.bvh#2"], "at": [1.0, 2.0]},
        {"use": "pose", "pose": {"file": "a.bvh", "time": 1.0}},
        {"use": "pose", "pose": pose, "frame": "world", "joints": ["head"]},
        {"use": "like", "clip": "a.bvh", "timing": "free"},
        {"use": "like", "clip": {"positions": [pose, pose], "fps": 20}},
    ):
        schema.validate({"prompt": "x", "seconds": 3.0, "goal": [goal]})
    for wrong in ({"use": "pose", "pose": 3}, {"use": "like"}, {"use": "like", "clip": {"fiel": "a.bvh"}}):
        assert not schema.is_valid({"prompt": "x", "seconds": 3.0, "goal": [wrong]})


def test_networks_are_told_poses_in_the_world_and_none_that_the_pelvis_carries() -> None:
    pose = standing(1)[0].tolist()
    told = Task(prompt="x", seconds=3.0, goals=[{"use": "pose", "pose": pose, "frame": "world", "at": 1.0}]).terms
    found = conditions_of(Objective(told), context(), Pose2D((3.0, 0.0, 1.0), 0.5), 3.0, SPEC)
    assert len(found) == 22 and set(found.times.tolist()) == {1.0} and bool(found.position_mask.all())
    assert found.positions.double().numpy() == pytest.approx(np.array(pose), abs=1e-5)
    carried = Task(prompt="x", seconds=3.0, goals=[{"use": "pose", "pose": pose, "at": 1.0}]).terms
    assert not len(conditions_of(Objective(carried), context(), Pose2D(), 3.0, SPEC))
    assert math.isfinite(carried[0].allowed)
