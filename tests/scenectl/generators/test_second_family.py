"""A family without tokens or weights, on a clock of its own, through everything that a user does with a generator."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import scenectl as sc
from scenectl.generators import load_generator, registry
from scenectl.pipeline.results import load_result
from scenes.errors import UserError
from tests.scenectl.lively import FAMILY, Lively

TASK = """
prompt = "a person sways"
seconds = 3.0
start = { position = [0.0, 0.0] }
samples = 2

[[scene.primitives]]
shape = "cylinder"
center = [0.9, 1.0, 0.0]
radius = 0.2
height = 2.0

[[goal]]
use = "joint_target"
joint = "right_wrist"
position = [-0.25, 1.0, 0.2]
at = 2.0

[[goal]]
use = "sdf_penetration"
"""


@pytest.fixture(autouse=True)
def _registered() -> Iterator[None]:
    registry.register(FAMILY)
    yield
    registry.forget("lively")


@pytest.fixture
def task_file(tmp_path: Path) -> Path:
    path = tmp_path / "task.toml"
    path.write_text(TASK)
    return path


def test_tasks_name_it_and_are_checked_on_its_clock() -> None:
    table = {"prompt": "sways", "start": [0.0, 0.0]}
    task = sc.Task(**table, seconds=1.2, generator={"name": "lively", "sway": 0.05})
    assert task.build().seconds == 1.2  # shorter than MSCoT's shortest
    loaded = load_generator("lively", sway=0.05)
    assert isinstance(loaded, Lively) and loaded.settings.sway == 0.05
    for given, words in (
        ({"generator": {"name": "lively", "cfg": 2.0}}, "unknown key 'cfg'"),
        ({"generator": {"name": "lively", "sway": -1.0}}, "sway"),
        ({"generator": {"name": "livly"}}, "did you mean 'lively'"),
        ({"generator": {"name": "lively"}, "seconds": 21.0}, "1 to 20 s"),
    ):
        with pytest.raises(UserError, match=words):
            sc.Task(**{**table, "seconds": 3.0, **given})
    with pytest.raises(UserError, match="has no weights"):
        load_generator("lively", "default2")


def test_a_run_meets_its_goals_and_writes_what_others_read(task_file: Path, tmp_path: Path) -> None:
    result = sc.run(sc.load_task(task_file).with_generator("lively"))
    assert result.motion.fps == 30.0 and result.motion.joints.shape == (2, 90, 22, 3)
    assert result.samples[0].met and result.report["fps"] == 30.0
    assert result.report["generator"]["name"] == "lively"
    motion, report = load_result(result.save(tmp_path / "out", preview=False))
    assert motion.fps == 30.0 and sc.Task(**report["task"]).generator.name == "lively"
    assert sc.score(motion, sc.load_task(task_file).with_generator("lively")).samples[0].met


def test_the_command_line_runs_edits_and_benches_it(
    task_file: Path, tmp_path: Path, scenectl: Callable[..., object]
) -> None:
    out = tmp_path / "out"
    said = scenectl("run", task_file, "-o", out, "--generator", "lively", "--samples", 1, "--allow-unmet")
    assert said.status == 0 and "joint_target: met" in said.out, said.err  # type: ignore[attr-defined]
    assert (out / "preview.png").is_file()
    said = scenectl(
        "edit", out, "--generator", "lively", "--regenerate", "1-2", "--prompt", "sways", "-o", tmp_path / "e",
        "--allow-unmet",
    )  # fmt: skip
    assert said.status == 0, said.err  # type: ignore[attr-defined]
    said = scenectl(
        "bench", "rooms", "--tasks", 1, "--samples", 1, "--generator", "lively", "--json", tmp_path / "r.json"
    )
    assert said.status == 0 and (tmp_path / "r.json").is_file(), said.err  # type: ignore[attr-defined]
    said = scenectl("bench", "posterior", "--generator", "lively")
    assert said.status == 2 and "lively" in said.err  # type: ignore[attr-defined]


def test_other_packages_register_theirs(monkeypatch: pytest.MonkeyPatch) -> None:
    class Point:
        name, value = "theirs", "theirs.scenectl:FAMILY"

        def load(self) -> object:
            return "no family"

    registry.forget("lively")
    monkeypatch.setattr(registry, "entry_points", lambda **asked: [Point()])
    assert "theirs" in registry.names()
    with pytest.raises(UserError, match=r"theirs\.scenectl:FAMILY is no"):
        registry.find("theirs")
    monkeypatch.setattr(Point, "load", lambda self: FAMILY)
    assert registry.find("theirs") is FAMILY
    with pytest.raises(UserError, match="registered already"):
        registry.register(registry.Family("theirs", FAMILY.spec, FAMILY.settings, FAMILY.open))
