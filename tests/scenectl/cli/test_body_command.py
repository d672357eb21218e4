"""`scenectl body`: characters and robots in, capsules and how tightly they fit out; tasks with a body of their own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenectl.tasks.task import Task, load_task
from scenes.body.body import DEFAULT_BODY
from scenes.body.proxies import Proxies
from scenes.errors import UserError
from tests.scenes.body.rigs import arm, humanoid, robot

Run = Callable[..., Any]
MIXAMO = {
    "pelvis": "Hips", "left_hip": "LeftUpLeg", "right_hip": "RightUpLeg", "spine1": "Spine", "left_knee": "LeftLeg",
    "right_knee": "RightLeg", "spine2": "Spine1", "left_ankle": "LeftFoot", "right_ankle": "RightFoot",
    "spine3": "Spine2", "left_foot": "LeftToeBase", "right_foot": "RightToeBase", "neck": "Neck",
    "left_collar": "LeftShoulder", "right_collar": "RightShoulder", "head": "Head", "left_shoulder": "LeftArm",
    "right_shoulder": "RightArm", "left_elbow": "LeftForeArm", "right_elbow": "RightForeArm",
    "left_wrist": "LeftHand", "right_wrist": "RightHand",
}  # fmt: skip


def test_without_a_file_it_prints_our_own_body(scenectl: Run, tmp_path: Path) -> None:
    said = scenectl("body")
    assert said.status == 0 and "ANSUR II" in said.out and "left_knee" in said.out
    for option in ("--json", "--png"):
        said = scenectl("body", option, tmp_path / "x")
        assert said.status == 2 and "give a URDF, MJCF or GLB file" in said.err and not (tmp_path / "x").exists()


def test_what_collides_less_than_it_shows_is_told(scenectl: Run, tmp_path: Path) -> None:
    said = scenectl("body", robot(tmp_path))
    assert said.status == 0
    assert "in doubt: 1 of 1 visual shapes of link 'base' (sphere 1) reach up to 9.00 m" in said.err


def test_a_robot_is_fitted_printed_stored_and_read_again(scenectl: Run, tmp_path: Path) -> None:
    said = scenectl("body", robot(tmp_path), "--json", tmp_path / "lamp.json")
    assert said.status == 0, said.err
    rows = {line.split()[0]: line.split() for line in said.out.splitlines() if line.strip()}
    assert rows["forearm"][1:7] == ["1", "0.020", "0.160", "1.01", "mesh", "0.0"]
    assert "lamp: 4 capsules on 4 of 5 links" in said.out and "body of our 22 joints" not in said.out
    again = scenectl("body", tmp_path / "lamp.json")
    assert again.status == 0 and again.out.splitlines() == said.out.splitlines()[:-1]
    assert Proxies.load(tmp_path / "lamp.json").body is None


def test_a_character_with_other_names_becomes_a_body_that_tasks_use(scenectl: Run, tmp_path: Path) -> None:
    path = humanoid([f"mixamorig:{name}" for name in MIXAMO.values()]).save(tmp_path / "person.glb")
    said = scenectl("body", path, "--json", tmp_path / "person.json")
    assert said.status == 0 and "as a body of our 22 joints: fitted to" in said.out
    (tmp_path / "task.toml").write_text('prompt = "a person walks"\nseconds = 3.0\nbody = "person.json"\n')
    problem = load_task(tmp_path / "task.toml").build()
    assert problem.body == Proxies.load(tmp_path / "person.json").body and problem.body != DEFAULT_BODY
    assert problem.context.body is problem.body
    assert problem.start.position[1] == pytest.approx(problem.body.sole_offset)
    assert Task(**problem.task.dump()).load_body() == problem.body


def test_bodies_that_tasks_cannot_use_are_told(scenectl: Run, tmp_path: Path) -> None:
    scenectl("body", robot(tmp_path), "--json", tmp_path / "lamp.json")
    task = Task(prompt="a person walks", seconds=3.0, body=tmp_path / "lamp.json")
    with pytest.raises(UserError, match="scenectl retarget"):
        task.build()
    with pytest.raises(UserError, match="does not exist"):
        Task(prompt="a person walks", seconds=3.0, body="nowhere.json").build()


@pytest.mark.parametrize("arguments", [["nowhere.glb"], ["notes.txt"], ["arm.glb", "--coverage", "0.1"]])
def test_bad_input_is_answered_with_one_sentence_and_status_2(
    scenectl: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    arm().save(tmp_path / "arm.glb")
    said = scenectl("body", *arguments)
    assert said.status == 2 and said.err.strip().count("\n") == 0 and "Traceback" not in said.err


def test_the_picture_shows_the_character_and_its_capsules(scenectl: Run, tmp_path: Path) -> None:
    from PIL import Image

    said = scenectl("body", robot(tmp_path), "--png", tmp_path / "lamp.png")
    if said.status == 2 and "EGL" in said.err:
        pytest.skip("needs EGL")
    assert said.status == 0, said.err
    image = np.asarray(Image.open(tmp_path / "lamp.png").convert("RGB")).astype(float)
    height, width, _ = image.shape
    middle = image[height // 8 : -height // 8, width // 3 : -width // 3]
    colourful = np.ptp(middle, axis=2) > 25  # the mesh is grey and the sky pale: only glass is colourful
    assert 0.1 < colourful.mean() < 0.9
