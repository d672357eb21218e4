"""`scenectl export` and `scenectl run --export`."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch
import trimesh

from scenectl.data.formats.bvh import read_bvh
from scenectl.export.animation import Animation
from scenectl.export.export import FORMATS
from scenectl.export.settings import Settings
from scenes.motion.motion import Motion
from tests.scenectl.export.moving import OWN, moving
from tests.scenectl.small import walk

Run = Callable[..., Any]
RESULT = Path(__file__).parents[1] / "pipeline" / "format_1"


@pytest.fixture
def result(tmp_path: Path) -> Path:
    """A folder that an earlier version's `run` wrote, with a box in its scene."""
    shutil.copytree(RESULT, tmp_path / "out")
    return tmp_path / "out"


@pytest.fixture
def rooms(monkeypatch: pytest.MonkeyPatch) -> list[Settings]:
    """Settings that a format was given which writes scenes and characters, `.room`."""
    given: list[Settings] = []
    module: Any = ModuleType("scenectl.export.room")
    module.SEVERAL, module.TAKES = True, frozenset({"scene", "character", "joints"})

    def write(animations: Sequence[Animation], path: Path, settings: Settings) -> None:
        given.append(settings)

    module.write = write
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setitem(FORMATS, ".room", "room")
    return given


def test_a_result_becomes_files_of_all_kinds(scenectl: Run, result: Path, tmp_path: Path) -> None:
    frames = Motion.load(result / "motion.npz").frames
    for name in ("x.bvh", "x.csv", "x.npz"):
        said = scenectl("export", result, "-o", tmp_path / name, "--names", "mixamo", "--up", "z", "--unit", "cm")
        assert said.status == 0 and not said.err, said
        assert f"wrote {tmp_path / name}: {frames} frames at 20 a second" in said.out
    assert read_bvh(tmp_path / "x.bvh").names[0] == "mixamorig:Hips"
    assert (tmp_path / "x.csv").read_text().startswith("time_s,mixamorig:Hips_x_cm,")
    more = ("--layout", "bodies", "--fps", 60, "--root-motion", "off")
    assert scenectl("export", result, "-o", tmp_path / "y.npz", *more).status == 0
    places = np.load(tmp_path / "y.npz")["body_positions"]
    assert len(places) == 3 * (frames - 1) + 1 and np.ptp(places[:, 0, :2], axis=0).max() < 1e-6


def test_samples_are_chosen(scenectl: Run, tmp_path: Path) -> None:
    joints = torch.stack([moving(10, seed).joints for seed in range(3)])
    Motion(joints, skeleton=OWN).save(tmp_path / "m.npz")
    assert scenectl("export", tmp_path / "m.npz", "-o", tmp_path / "x.npz", "--sample", 2).status == 0
    back = np.load(tmp_path / "x.npz")["global_joint_positions"]
    np.testing.assert_allclose(back[..., 2], joints[2, ..., 1], atol=1e-4)
    said = scenectl("export", tmp_path / "m.npz", "-o", tmp_path / "x.npz", "--all")
    assert said.out.count("wrote") == 3 and (tmp_path / "x_2.npz").read_bytes()
    said = scenectl("export", tmp_path / "m.npz", "-o", tmp_path / "x.npz", "--sample", 3)
    assert said.status == 2 and "3 motions; --sample goes from 0 to 2" in said.err


def test_what_a_foreign_file_does_not_say_is_stated(scenectl: Run, tmp_path: Path) -> None:
    made = walk(30).numpy()
    made[::2, 15] += 0.01  # a head that is not fixed to its neck
    np.save(tmp_path / "x.npy", 100 * made[..., [0, 2, 1]] * [1, -1, 1])
    source = ("--from-fps", 30, "--from-unit", "cm", "--from-up", "z")
    said = scenectl("export", tmp_path / "x.npy", "-o", tmp_path / "x.csv", *source, "--fps", 60, "--unit", "mm")
    assert said.status == 0 and "59 frames at 60 a second" in said.out
    heads, first = (line.split(",") for line in (tmp_path / "x.csv").read_text().splitlines()[:2])
    pelvis = [float(first[heads.index(f"pelvis_{axis}_mm")]) for axis in "xyz"]
    assert np.allclose(pelvis, 1000 * made[0, 0], atol=30)
    assert "joints moved by" in said.out and "mm at most, so that bones keep their lengths" in said.out
    said = scenectl("export", tmp_path / "x.npy", "-o", tmp_path / "x.csv")
    assert said.status == 2 and "frames a second" in said.err


def test_the_scene_is_that_of_the_report_or_the_file_that_is_named(
    scenectl: Run, result: Path, rooms: list[Settings], tmp_path: Path
) -> None:
    room, file = tmp_path / "room.glb", tmp_path / "x.room"
    trimesh.creation.box(bounds=[[-3, 0, -3], [3, 2.5, 3]]).export(room)
    for words in (
        (result, "-o", file),
        (result, "--scene", "-o", file),
        (result, "--scene", room, "-o", file),
        (result, room, "-o", file),
        (result / "motion.npz", "-o", file, "--scene", room),
    ):
        assert scenectl("export", *words).status == 0
    none, own, *others = (settings.scene for settings in rooms)
    assert none is None and own is not None and all(other is not None for other in others)
    inside, beside = own.distance(torch.tensor([[1.5, 0.5, 1.0], [0.5, 0.5, 1.0]])).tolist()
    assert inside < 0 < beside
    for other in others:
        np.testing.assert_allclose(other.bounds, [[-3, 0, -3], [3, 2.5, 3]], atol=1e-3)


def test_a_mapping_is_toml_or_json(scenectl: Run, result: Path, rooms: list[Settings], tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text('left_knee = "LeftLeg"\n')
    (tmp_path / "m.json").write_text(json.dumps({"left_knee": "LeftLeg"}))
    hero = ("--character", tmp_path / "hero.glb")
    for name in ("m.toml", "m.json"):
        said = scenectl("export", result, "-o", tmp_path / "x.room", *hero, "--joints", tmp_path / name)
        assert said.status == 0 and rooms[-1].joints == {"left_knee": "LeftLeg"}
    for text, sentence in (
        ('left_nee = "x"', "did you mean 'left_knee'"),
        ("left_knee = 3", "is no table of names; write lines such as"),
        ("left_knee", "is not valid TOML"),
    ):
        (tmp_path / "m.toml").write_text(text)
        said = scenectl("export", result, "-o", tmp_path / "x.room", *hero, "--joints", tmp_path / "m.toml")
        assert said.status == 2 and sentence in said.err and "m.toml" in said.err


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("-o", "x.fbx"), "ends with '.fbx'"),
        (("-o", "x"), "has no ending"),
        (("-o", "x.bvh", "--root-motion", "no"), "give on or off"),
        (("-o", "x.bvh", "--sample", 0, "--all"), "exclude each other"),
        (("-o", "x.bvh", "--sample", 1), "holds one motion; --sample is 0"),
        (("-o", "x.bvh", "--names", "mixmo"), "did you mean 'mixamo'"),
        (("-o", "x.bvh", "--unit", "league"), "unknown unit 'league'"),
        (("-o", "x.bvh", "--up", "w"), "unknown up axis 'w'"),
        (("-o", "x.npz", "--layout", "limbs"), "unknown layout 'limbs'"),
        (("-o", "x.bvh", "--layout", "bodies"), "take no layout"),
        (("-o", "x.csv", "--scene"), "take no scene"),
        (("-o", "x.bvh", "--fps", 0), "0 frames a second cannot be written"),
        (("-o", "x.bvh", "--from-fps", 20), "is a result; leave them out"),
        (("-o", "x.bvh", "--joints", "nowhere.toml"), "'nowhere.toml' does not exist"),
        (("-o", "/dev/null/x.bvh"), "cannot write '/dev/null/x.bvh'"),
    ],
)
def test_errors_are_one_sentence(
    words: tuple[object, ...],
    sentence: str,
    scenectl: Run,
    result: Path,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    said = scenectl("export", result, *words)
    assert said.status == 2 and sentence in said.err and len(said.err.strip().splitlines()) == 1, said.err
    assert not list((tmp_path / "here").iterdir())


def test_a_folder_that_is_no_result_is_told(scenectl: Run, rooms: list[Settings], tmp_path: Path) -> None:
    said = scenectl("export", tmp_path, "-o", tmp_path / "x.bvh")
    assert said.status == 2 and f"'{tmp_path}/motion.npz' does not exist" in said.err
    Motion(walk(20)).save(tmp_path / "motion.npz")
    assert scenectl("export", tmp_path, "-o", tmp_path / "x.bvh").status == 0
    said = scenectl("export", tmp_path, "--scene", "-o", tmp_path / "x.room")
    assert said.status == 2 and "give its file, as in --scene room.glb" in said.err


def test_run_writes_files_beside_its_result(
    scenectl: Run, tiny_generator: None, rooms: list[Settings], tmp_path: Path
) -> None:
    (tmp_path / "task.toml").write_text('prompt = "a person walks"\nseconds = 2.0\nsamples = 2\n')
    words = ("run", tmp_path / "task.toml", "-o", tmp_path / "out", "--no-preview", "--allow-unmet", "--export")
    said = scenectl(*words, "bvh,room")
    assert said.status == 0 and f"wrote {tmp_path / 'out' / 'motion.bvh'}: 40 frames" in said.out
    assert "motion.room: 2 motions, 40 frames" in said.out and len(rooms) == 1
    assert len(read_bvh(tmp_path / "out" / "motion.bvh").values) == 40
    said = scenectl(*words[:3], tmp_path / "other", *words[4:], "bvh,fbx")
    assert said.status == 2 and "'.fbx'" in said.err and not (tmp_path / "other").exists()
