"""Files of a result: whole, of one run, and believed only as far as their schema goes."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import torch
from hypothesis import HealthCheck, given, settings, strategies as st

import scenectl as sc
from scenectl.generators.mscot.sampling import MSCoT
from scenectl.pipeline.results import Result, load_result
from scenectl.pipeline.tables import FORMAT, ReportTable
from scenectl.view import of_folder
from scenes.errors import UserError
from scenes.motion.motion import Motion
from tests.scenectl.small import bundle

OLD = Path(__file__).with_name("format_1")
"""A result of format 1, as the version before verdicts wrote it; its task lay where the tests are run."""


@pytest.fixture(scope="module")
def result(tiny: ModuleType) -> Result:
    goal = sc.Term("height_limit", {"limit": 1.0}, name="tall", window=(0.5, 1.0))
    task = sc.Task(prompt="a statue slides", seconds=2.0, samples=2, seed=4, goals=[goal])
    return sc.run(task, generator=tiny.TinyGenerator())


def drawn(result: Result, png: Path) -> None:
    png.write_text(f"seed {result.report['seed']}")


def seeded(result: Result, seed: int) -> Result:
    return Result(result.setup, result.motion, result.samples, {**result.report, "seed": seed}, drawn)


# ---- what a report says ---------------------------------------------------------------------------------------------


def test_a_report_is_what_its_schema_knows_and_no_more(result: Result, tmp_path: Path) -> None:
    _, report = load_result(result.save(tmp_path))
    table = ReportTable.model_validate_json((tmp_path / "report.json").read_text())
    assert json.loads(table.model_dump_json(exclude_unset=True)) == report == json.loads(json.dumps(result.report))
    assert report["format"] == FORMAT
    for row, sample in zip(report["samples"], result.samples, strict=True):
        assert (row["met"], row["believable"]) == (sample.met, sample.believable)
        assert row["verdict"] == json.loads(json.dumps(sample.verdict.as_dict()))
    assert report["machine"]["threads"] == 1
    assert report["machine"]["instruction_set"] == torch.backends.cpu.get_cpu_capability()


def test_the_series_have_a_number_for_each_frame_and_none_where_a_goal_is_not_active(result: Result) -> None:
    for rank, row in enumerate(result.report["samples"]):
        residuals = row["series"]["residuals"]["tall"]
        assert [value is not None for value in residuals] == [10 <= frame <= 20 for frame in range(40)]
        term = result.setup.objective.terms[0]
        expected = term.residual(result.motion[rank], result.setup.context).amax(-1)
        assert residuals[10:21] == pytest.approx(expected[10:21].tolist(), abs=5.1e-5)
        assert max(residuals[10:21]) == pytest.approx(row["terms"][0]["worst"], abs=5.1e-5)
        for values in (row["series"].get("speed_m_per_s", []), *row["series"].get("clearance_m", {}).values()):
            assert len(values) in (0, 40)


# ---- what is read ---------------------------------------------------------------------------------------------------


def test_a_result_of_the_old_format_still_opens(
    scenectl: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    motion, report = load_result(OLD)
    assert report["format"] == 1 and motion.joints.shape == (1, 40, 22, 3)
    row = report["samples"][0]
    assert row["met"] is True and row["believable"] is row["verdict"] is row["series"] is None
    picture = of_folder(OLD)
    assert picture.path is not None and picture.marks and picture.title == report["prompt"]
    task = tmp_path / "task.toml"
    task.write_text('prompt = "a person walks forward"\nseconds = 2.0\n')
    assert scenectl("score", OLD, task, "--json", tmp_path / "score.json", "--allow-unmet").status == 0
    assert json.loads((tmp_path / "score.json").read_text())["format"] == FORMAT
    monkeypatch.setattr("scenectl.generators.load_generator", lambda *_, **__: MSCoT(bundle()))
    words = ("edit", OLD, "--regenerate", "0.5-1", "--prompt", "a person walks", "-o", tmp_path / "out")
    said = scenectl(*words, "--allow-unmet")
    assert said.status == 0, said.err
    assert load_result(tmp_path / "out")[1]["edit"]["regenerated_frames"] == list(range(10, 20))


def edited(report: dict[str, Any], path: tuple[str | int, ...], value: Any) -> None:
    *way, last = path
    for key in way:
        report = report[key]  # type: ignore[index]
    report[last] = value  # type: ignore[index]


WRONG: dict[str, tuple[tuple[str | int, ...], Any]] = {
    "a ragged path": (("walk",), {"path": [[0, 0, 0], [0, 0]], "length_m": 1.0}),
    "a path in words": (("walk",), {"path": "there and back", "length_m": 1.0}),
    "a path of words": (("walk",), {"path": [["a", "b", "c"]], "length_m": 1.0}),
    "a path of nothing": (("walk",), {"path": [], "length_m": 0.0}),
    "a number as a folder": (("task", "folder"), 1),
    "no samples": (("samples",), []),
    "samples that are words": (("samples",), ["x"]),
    "a later format": (("format",), FORMAT + 1),
    "a truth as a number": (("seconds",), True),
    "a number as a text": (("fps",), "20"),
    "a task in a list": (("task",), [1]),
    "a series in words": (("samples", 0, "series"), {"residuals": {"tall": "high"}}),
    "a verdict without a sentence": (("samples", 0, "verdict"), {"findings": []}),
    "a seed of half": (("seed",), 0.5),
}


@pytest.mark.parametrize("what", WRONG)
def test_a_report_that_its_schema_does_not_know_is_refused(
    what: str, result: Result, scenectl: Callable[..., Any], tmp_path: Path
) -> None:
    result.save(tmp_path)
    report = json.loads((tmp_path / "report.json").read_text())
    edited(report, *WRONG[what])
    (tmp_path / "report.json").write_text(json.dumps(report))
    said = scenectl("view", tmp_path, "--png", tmp_path / "x.png")
    assert said.status == 2 and len(said.err.strip().splitlines()) == 1, said.err
    assert "report.json' is not a report" in said.err.replace("\n", " ")
    assert not (tmp_path / "x.png").exists()


TEXTS = (
    "",
    "null",
    "[]",
    "{",
    '{"format": NaN}',
    "[" * 3000,
    '{"format": 1' + "0" * 5000 + "}",
    "\ufeff{}",
    "5",
    '"x"',
)


@pytest.mark.parametrize("text", TEXTS, ids=range(len(TEXTS)))
def test_a_report_that_is_none_is_refused(text: str, result: Result, tmp_path: Path) -> None:
    result.save(tmp_path)
    (tmp_path / "report.json").write_text(text)
    with pytest.raises(UserError, match=r"report\.json"):
        load_result(tmp_path)


def places(value: Any, way: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Every way to a value inside nested tables and lists."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [found for key, item in items for found in ((*way, key), *places(item, (*way, key)))]


REPORT = json.loads((OLD / "report.json").read_text())
PLACES = places(REPORT)
JUNK = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5), st.lists(st.integers(), max_size=3),
    st.dictionaries(st.text(max_size=3), st.integers(), max_size=2),
)  # fmt: skip


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_whatever_stands_in_a_report_opens_or_is_refused_in_a_sentence(data: st.DataObject, tmp_path: Path) -> None:
    report = json.loads(json.dumps(REPORT))
    edited(report, data.draw(st.sampled_from(PLACES)), data.draw(JUNK))
    shutil.copy(OLD / "motion.npz", tmp_path / "motion.npz")
    (tmp_path / "report.json").write_text(json.dumps(report))
    try:
        picture = of_folder(tmp_path)
    except UserError as error:
        assert "\n" not in str(error)
    else:
        assert picture.motion is not None


def test_a_report_that_is_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    shutil.copy(OLD / "motion.npz", tmp_path / "motion.npz")
    os.mkfifo(tmp_path / "report.json")
    with pytest.raises(UserError, match=r"is a pipe.*; run the task again"):
        load_result(tmp_path)


def test_a_motion_of_another_run_is_told(result: Result, tmp_path: Path) -> None:
    one, other = seeded(result, 1).save(tmp_path / "one"), seeded(result, 2).save(tmp_path / "other")
    shutil.copy(other / "motion.npz", one / "motion.npz")
    with pytest.raises(UserError, match=r"different runs \(seed 2 and 1\)"):
        load_result(one)
    report = json.loads((other / "report.json").read_text())
    (other / "report.json").write_text(json.dumps({**report, "samples": report["samples"][:1]}))
    with pytest.raises(UserError, match=r"different runs \(number of samples 2 and 1\)"):
        load_result(other)


# ---- what a kill or a full disk leaves ------------------------------------------------------------------------------


class Killed(BaseException):
    """The process ended here."""


def killed(call: Callable[..., Any], at: int, count: list[int]) -> Callable[..., Any]:
    """The call, before which the process ends the `at`-th time that any of those that share `count` is made."""

    def dying(*given: Any, **named: Any) -> Any:
        count[0] += 1
        if count[0] >= at:
            raise Killed
        return call(*given, **named)

    return dying


@pytest.mark.parametrize("at", range(1, 9))
def test_a_kill_leaves_no_file_beside_those_of_another_run(
    at: int, result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seeded(result, 1).save(tmp_path)
    count = [0]
    with monkeypatch.context() as patched, pytest.raises(Killed):
        for owner, name in ((os, "replace"), (os, "fsync"), (Path, "unlink"), (Path, "write_text")):
            patched.setattr(owner, name, killed(getattr(owner, name), at, count))
        seeded(result, 2).save(tmp_path)
        raise Killed  # it got through
    left = {path.name for path in tmp_path.iterdir() if not path.name.endswith(".tmp")}
    assert "motion.npz" in left
    if "report.json" in left:
        seed = load_result(tmp_path)[1]["seed"]
        assert "preview.png" not in left or (tmp_path / "preview.png").read_text() == f"seed {seed}"
    else:
        assert "preview.png" not in left or count[0] == 0


def test_what_cannot_be_written_leaves_the_old_result(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seeded(result, 1).save(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with monkeypatch.context() as patched:
        patched.setattr(Motion, "write", lambda *_, **__: (_ for _ in ()).throw(OSError(28, "No space left on device")))
        with pytest.raises(UserError, match=r"motion\.npz.*No space left"):
            seeded(result, 2).save(tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr(json, "dump", lambda *_, **__: (_ for _ in ()).throw(OSError(28, "No space left on device")))
        with pytest.raises(UserError, match=r"report\.json.*No space left"):
            seeded(result, 2).save(tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_linked_files_are_replaced_where_they_lie(result: Result, tmp_path: Path) -> None:
    kept, folder = tmp_path / "kept", tmp_path / "out"
    seeded(result, 1).save(kept)
    folder.mkdir()
    for name in ("motion.npz", "report.json", "preview.png"):
        (folder / name).symlink_to(kept / name)
    seeded(result, 2).save(folder)
    assert load_result(kept)[1]["seed"] == load_result(folder)[1]["seed"] == 2
    assert (kept / "preview.png").read_text() == "seed 2"
