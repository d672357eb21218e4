"""`score`, `view` and `edit` take motions that others wrote, and say what they did with them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from scenectl.export.export import export
from scenectl.generators.mscot.sampling import MSCoT
from scenes.motion.motion import Motion
from tests.scenectl.small import bundle, walk

Run = Callable[..., Any]
WALK = walk(60)
HEAD = 'prompt = "a person walks"\nseconds = 3.0\n'


@pytest.fixture
def task(tmp_path: Path) -> Path:
    path = tmp_path / "task.toml"
    path.write_text(HEAD + '[[goal]]\nuse = "head_height"\nheight = 1.5\nat = 1.0\ntolerance = 1.0\n')
    return path


def files(folder: Path) -> dict[str, Path]:
    np.save(folder / "x.npy", WALK.numpy())
    np.savez(folder / "x.npz", joints=WALK.numpy())
    export(Motion(WALK), folder / "x.bvh")
    return {suffix: folder / f"x.{suffix}" for suffix in ("npy", "npz", "bvh")}


def test_score_calls_samples_by_their_place_in_the_file(scenectl: Run, tmp_path: Path) -> None:
    task = tmp_path / "task.toml"
    task.write_text(HEAD + f'[[goal]]\nuse = "head_height"\nheight = {float(WALK[20, 15, 1])}\nat = 1.0\n')
    np.save(tmp_path / "x.npy", torch.stack([0.8 * WALK, WALK]).numpy())
    said = scenectl("score", tmp_path / "x.npy", task, "--fps", 20).out
    assert [line.split()[:2] for line in said.splitlines() if line[:2] in ("0 ", "1 ")] == [["0", "1"], ["1", "0"]]
    assert "sample 0 is not met: " in said and "the goals of sample 1:" in said


def test_view_of_a_task_says_what_to_view(task: Path, scenectl: Run, tmp_path: Path) -> None:
    said = scenectl("view", task, "--png", tmp_path / "x.png")
    assert said.status == 2 and "is a task; make motions with scenectl run" in said.err


@pytest.mark.parametrize("suffix", ["npy", "npz", "bvh"])
def test_score_takes_what_others_write(suffix: str, task: Path, scenectl: Run, tmp_path: Path) -> None:
    path = files(tmp_path)[suffix]
    said = scenectl("score", path, task, "--json", tmp_path / "r.json", *([] if suffix == "bvh" else ["--fps", 20]))
    assert "head_height: met" in said.out and "Traceback" not in said.err
    assert ("unit cm (guessed" in said.err) == (suffix == "bvh")
    assert json.loads((tmp_path / "r.json").read_text())["fps"] == 20.0
    if suffix != "bvh":
        said = scenectl("score", path, task)
        assert said.status == 2 and "--fps 30" in said.err


def test_what_looks_wrong_is_doubted_aloud(task: Path, scenectl: Run, tmp_path: Path) -> None:
    np.save(tmp_path / "z.npy", WALK.numpy()[..., [0, 2, 1]] * [1, -1, 1])
    said = scenectl("score", tmp_path / "z.npy", task, "--fps", 20)
    assert "in doubt" in said.err and "--up z" in said.err
    np.save(tmp_path / "mm.npy", WALK.numpy() * 1000)
    said = scenectl("score", tmp_path / "mm.npy", task, "--fps", 20)
    assert said.status == 2 and "state --unit mm" in said.err
    assert "head_height: met" in scenectl("score", tmp_path / "mm.npy", task, "--fps", 20, "--unit", "mm").out


def test_view_and_edit_refuse_a_sample_that_is_not_there(scenectl: Run, tmp_path: Path) -> None:
    path = files(tmp_path)["npy"]
    for words in (
        ("view", path, "--png", tmp_path / "x.png"),
        ("edit", path, "--regenerate", "1-2", "--prompt", "x", "-o", tmp_path / "out"),
    ):
        said = scenectl(*words, "--fps", 20, "--sample", 3)
        assert said.status == 2 and "holds one motion; --sample is 0" in said.err
    said = scenectl("view", tmp_path, "--unit", "cm", "--png", tmp_path / "x.png")
    assert said.status == 2 and "is a result; leave them out" in said.err
    said = scenectl("view", "stairs", "--fps", 20, "--png", tmp_path / "x.png")
    assert said.status == 2 and "--fps is for motions" in said.err


def test_edit_brings_a_motion_to_the_generators_rate_and_keeps_the_task_of_a_result(
    scenectl: Run, task: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scenectl.generators.load_generator", lambda *args, **kwargs: MSCoT(bundle()))
    np.save(tmp_path / "fast.npy", Motion(WALK).resampled(60.0).joints.numpy())
    words = ("--regenerate", "1-2", "--prompt", "someone sits", "--no-preview")
    said = scenectl(
        "edit", tmp_path / "fast.npy", "--fps", 60, *words, "--task", task, "-o", tmp_path / "one", "--allow-unmet"
    )
    assert said.status == 0, said
    assert "60 fps, every 3. frame kept" in said.err and "head_height" in said.out
    kept = torch.ones(60, dtype=torch.bool)
    kept[20:40] = False
    made = Motion.load(tmp_path / "one" / "motion.npz").joints[0]
    torch.testing.assert_close(made[kept], WALK[kept], atol=1e-4, rtol=0)
    said = scenectl("edit", tmp_path / "one", *words, "-o", tmp_path / "two", "--allow-unmet")
    assert said.status == 0 and "head_height" in said.out
    report = json.loads((tmp_path / "two" / "report.json").read_text())
    assert report["task"]["goals"][0]["use"] == "head_height" and report["prompt"] == "someone sits"
