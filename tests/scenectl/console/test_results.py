"""What commands print of a result, and the exit status that it earns."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from scenectl.console.results import UNMET
from scenectl.measures.believability.judge import Judge
from scenectl.measures.believability.verdict import Finding, Verdict
from scenes.errors import UserError
from scenes.motion.motion import Motion

TASK = 'prompt = "a statue slides"\nseconds = 2.0\nsamples = 3\n'
GOAL = '[[goal]]\nuse = "head_height"\nheight = {}\ntolerance = 0.5\n'
MET, UNREACHABLE = GOAL.format(1.5), GOAL.format(2.9)
LIMP = Verdict(
    (Finding("sliding", 0.5, 0.1, "m/s", "left foot slides at 0.50 m/s at 0.40 s", 0.4, "left_foot"),),
    exempted=("right wrist [exempt] 3 cm deep at 1.00 s",),
)

Command = Callable[..., Any]


@pytest.fixture
def judged(monkeypatch: pytest.MonkeyPatch) -> Callable[[Verdict], None]:
    def judge(verdict: Verdict) -> None:
        monkeypatch.setattr(Judge, "verdict", lambda self, motion, depths=None: verdict)

    return judge


@pytest.fixture
def task(tmp_path: Path) -> Callable[[str], Path]:
    def write(goals: str) -> Path:
        path = tmp_path / "task.toml"
        path.write_text(TASK + goals)
        return path

    return write


@pytest.mark.parametrize(
    ("goals", "verdict", "status"),
    [
        (MET, Verdict(), 0), (MET, LIMP, UNMET), (UNREACHABLE, Verdict(), UNMET), (UNREACHABLE, LIMP, UNMET),
        ("", LIMP, UNMET),
    ],
)  # fmt: skip
def test_run_and_score_end_with_3_where_no_sample_is_both_and_write_their_files_all_the_same(
    goals: str, verdict: Verdict, status: int, judged: Any, task: Any, tiny_generator: None, scenectl: Command,
    tmp_path: Path,
) -> None:  # fmt: skip
    judged(verdict)
    out, told = tmp_path / "out", tmp_path / "score.json"
    for allowed, expected in (((), status), (("--allow-unmet",), 0)):
        said = scenectl("run", task(goals), "-o", out, "--no-preview", *allowed)
        assert said.status == expected, said.err
        assert {path.name for path in out.iterdir()} == {"motion.npz", "report.json"}
        assert ("no sample is both" in said.err) == (expected == UNMET)
        said = scenectl("score", out, task(goals), "--json", told, *allowed)
        assert said.status == expected and ("no sample is both" in said.err) == (expected == UNMET)
        assert [row["believable"] for row in json.loads(told.read_text())["samples"]] == [verdict.believable] * 3
        told.unlink()


def test_one_sample_that_is_both_is_enough(
    monkeypatch: pytest.MonkeyPatch, task: Any, tiny_generator: None, scenectl: Command, tmp_path: Path
) -> None:
    verdicts = iter([LIMP, LIMP, Verdict()])
    monkeypatch.setattr(Judge, "verdict", lambda self, motion, depths=None: next(verdicts))
    said = scenectl("run", task(MET), "-o", tmp_path / "out", "--no-preview")
    assert said.status == 0
    rows = [line.split() for line in said.out.splitlines() if line[:1].isdigit()]
    # the goal, and the floor that whoever has goals avoids
    assert [row[:5] for row in rows] == [[k, "2", "of", "2", "yes" if k == "0" else "no"] for k in "012"]
    assert "sample 0 is" not in said.out
    assert "sample 1 is not believable: left foot slides at 0.50 m/s at 0.40 s\n" in said.out


def test_what_is_wrong_is_told_in_a_line_for_each_sample(
    judged: Any, task: Any, tiny_generator: None, scenectl: Command, tmp_path: Path
) -> None:
    judged(LIMP)
    said = scenectl("run", task(UNREACHABLE), "-o", tmp_path / "out", "--no-preview", "--samples", 11)
    wrong = [line for line in said.out.splitlines() if line.startswith("sample ")]
    assert len(wrong) == 8 and "and 3 more" in said.out
    assert all(" is not met: " in line and line.endswith(f"; not believable: {LIMP.sentence}") for line in wrong)
    assert "head_height: not met (worst" in said.out
    assert "right wrist [exempt] 3 cm deep at 1.00 s" in said.out


def test_an_edit_without_goals_is_judged_by_the_body_alone(
    judged: Any, tiny: Any, monkeypatch: pytest.MonkeyPatch, scenectl: Command, tmp_path: Path
) -> None:
    from scenectl.generators.mscot.sampling import MSCoT
    from tests.scenectl.small import bundle, walk

    monkeypatch.setattr("scenectl.generators.load_generator", lambda *_, **__: MSCoT(bundle()))
    Motion(walk(60)).save(tmp_path / "motion.npz")
    judged(LIMP)
    said = scenectl("edit", tmp_path, "--keep", "0-1.5", "--prompt", "someone sits", "-o", tmp_path / "out")
    assert said.status == UNMET and "no goals" in said.out, said.err
    assert (tmp_path / "out" / "report.json").is_file()


@pytest.mark.parametrize(
    "error", [OSError(28, "No space left on device"), UserError("cannot write 'x'"), MemoryError()]
)
def test_a_preview_that_fails_is_a_sentence_and_the_status_is_the_results(
    error: Exception, judged: Any, task: Any, tiny_generator: None, scenectl: Command, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    def fails(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("scenectl.view.picture.write", fails)
    for verdict, status in ((Verdict(), 0), (LIMP, UNMET)):
        judged(verdict)
        said = scenectl("run", task(MET), "-o", tmp_path / "out")
        assert said.status == status
        (line,) = [line for line in said.err.splitlines() if "preview.png" in line]
        assert line.startswith("scenectl: no preview.png, because ") and "Traceback" not in said.err
        assert "wrote motion.npz and report.json" in said.out
        assert {path.name for path in (tmp_path / "out").iterdir()} == {"motion.npz", "report.json"}
