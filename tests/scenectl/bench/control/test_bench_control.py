"""Ways of reaching keyframes, on an untrained model of a few codes."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenectl.bench.control import rivals
from scenectl.bench.control.control import FURTHEST, NEAREST, PILLARS, _cases, bench_control, plot
from scenectl.bench.control.keyframes import usable_clips
from scenectl.bench.control.rivals import METHODS
from scenectl.generators.mscot.sampling import MSCoT
from scenectl.measures.metrics import Scorer
from scenes.errors import UserError
from tests.scenectl.small import bundle
from tests.scenectl.tiny import TinyGenerator
from tests.scenectl.training.folder import walks

KEYS = {
    "method", "scene", "joint", "density", "frames", "seconds", "refine_seconds", "passes", "out_of_reach",
    "average_error_m", "location_error", "trajectory_error", "deepest_penetration_m", "deepest_floor_penetration_m",
    "moved_m", "max_acceleration_m_per_frame2", "skating_ratio",
}  # fmt: skip


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return walks(tmp_path_factory.mktemp("data"))


def test_every_method_has_a_row_beside_the_free_sample(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("PAPER_STEPS", "LOGIT_STEPS", "EMBEDDING_STEPS"):
        monkeypatch.setattr(rivals, name, 4)
    monkeypatch.setattr(rivals, "STEPS_TRIED", (1e-6, 1e-4))
    result = bench_control(MSCoT(bundle()), data, 1, METHODS, ("head",), ("2",))
    rows, summary = result["rows"], result["summary"]
    assert [row["method"] for row in rows] == ["uncontrolled", *METHODS]
    assert all(set(row) == KEYS for row in rows)
    free, *controlled = rows
    assert free["passes"] == 0 and free["moved_m"] == 0.0
    assert all(row["passes"] > 0 and row["refine_seconds"] > 0 for row in controlled)
    lbfgs, paper = controlled[-2], controlled[0]  # ours keeps to a body, and random networks have none
    assert lbfgs["average_error_m"] < min(paper["average_error_m"], 0.7 * free["average_error_m"])
    assert summary["motions"] == 1 and summary["paper_over_scenectl_passes"] > 0
    assert summary["scenectl_average_error_m_at_2"] == controlled[-1]["average_error_m"]
    assert all(row["deepest_penetration_m"] == 0.0 for row in rows)
    plot(result, tmp_path / "control.png")
    assert (tmp_path / "control.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("methods", "joints", "densities"),
    [(("papr",), ("head",), ("1",)), (("adam",), ("hed",), ("1",)), (("adam",), ("head",), ("3",))],
)
def test_what_is_not_known_is_named(data: Path, methods: tuple, joints: tuple, densities: tuple) -> None:
    with pytest.raises(UserError, match=r"unknown '(papr|hed|3)'"):
        bench_control(MSCoT(bundle()), data, 1, methods, joints, densities)


def test_clips_can_be_asked_to_be_long(data: Path) -> None:
    lengths = sorted({clip.frames for clip in usable_clips(data, MSCoT.spec)})
    assert {clip.frames for clip in usable_clips(data, MSCoT.spec, lengths[-1])} == {lengths[-1]} and len(lengths) > 1
    with pytest.raises(UserError, match=f"no captioned test clip of {lengths[-1] + 1} frames"):
        bench_control(MSCoT(bundle()), data, 1, shortest=lengths[-1] + 1)


def test_pillars_stand_close_to_the_recording_which_touches_none(data: Path) -> None:
    rows = bench_control(TinyGenerator(), data, 1, ("scenectl",), ("head",), ("2",), ("empty", "pillars"))["rows"]
    assert [row["scene"] for row in rows] == ["empty", "empty", "pillars", "pillars"]
    assert rows[0]["average_error_m"] == rows[2]["average_error_m"]  # the free sample knows nothing of pillars
    (case,) = _cases(usable_clips(data, MSCoT.spec), MSCoT.spec, 1, ("head",), ("2",), "pillars", 0)
    clearance = Scorer(case.scene).depths(case.keyframes.real).clearance.min()
    assert len(case.scene.primitives) == PILLARS and NEAREST <= clearance <= FURTHEST
    assert [term.goal for term in case.objective().terms] == ["joint_target", "sdf_penetration"]


def test_errors_are_summed_up_by_density(data: Path) -> None:
    result = bench_control(TinyGenerator(), data, 1, ("scenectl",), ("head",), ("2", "25%"))
    rows, summary = result["rows"], result["summary"]
    assert [row["density"] for row in rows] == ["2", "2", "25%", "25%"] and summary["motions"] == 2
    for row in rows:
        assert summary[f"{row['method']}_average_error_m_at_{row['density']}"] == row["average_error_m"]
