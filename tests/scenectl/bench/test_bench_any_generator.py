"""Benches take any generator; what only a generator of tokens has is refused in a sentence."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from scenectl.bench.control.control import bench_control
from scenectl.bench.control.facing import bench_facing
from scenectl.bench.control.keyframes import bench_keyframes
from scenectl.bench.control.pose_goals import bench_pose_goals
from scenectl.bench.control.rivals import METHODS, OF_TOKENS
from scenectl.bench.control.rooms import bench_rooms
from scenectl.bench.models.generator import bench_generator
from scenectl.bench.models.page import evaluation_page
from scenectl.bench.models.posterior import bench_posterior
from scenectl.bench.models.tokenizer import bench_tokenizer
from scenectl.evaluation.contrastive import Contrastive, ContrastiveConfig, ContrastiveEvaluator
from scenectl.evaluation.kinds import KindClassifier
from scenectl.evaluation.motions import EncoderConfig
from scenes.errors import UserError
from tests.scenectl.small import Words, walk
from tests.scenectl.tiny import TinyGenerator
from tests.scenectl.training.folder import walks, write_folder


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return walks(tmp_path_factory.mktemp("data"))


def test_rooms_are_walked_through() -> None:
    result = bench_rooms(TinyGenerator(), tasks=1, samples=1)
    assert result["summary"]["tasks"] == 3 and set(result["summary"]["rejected"]) == set(result["summary"]["by_mesh"])
    for row in result["rows"]:  # a statue slides there, as far as sliding may cost
        assert row["missed_m"] < row["planned_path_m"] / 8


def test_poses_are_counted_as_met_where_they_are(data: Path) -> None:
    (row,) = bench_pose_goals(TinyGenerator(), data, motions=1, clips=0, times=2)["rows"]
    assert row["goal"] == "pose" and row["mean_error_m"] <= row["worst_error_m"]
    assert row["met"] == (row["worst_error_m"] <= 0.01)


def test_keyframes_are_met(data: Path) -> None:
    summary = bench_keyframes(TinyGenerator(), data, 2, 1)["summary"]
    assert summary["average_error_m"] < 0.3 * summary["uncontrolled_error_m"]


def test_headings_are_measured_part_by_part(data: Path) -> None:
    result = bench_facing(TinyGenerator(), data, motions=3, moments=2)
    assert [row["part"] for row in result["rows"]] == ["pelvis", "chest"]  # and no third clip for the head
    for row in result["rows"]:  # a statue does not turn, and the recorded walk is straight but for its swing
        assert row["mean_error_deg"] == pytest.approx(row["uncontrolled_mean_error_deg"], abs=1e-3)
        assert row["met"] == (row["worst_error_deg"] <= 2.0) and row["worst_error_deg"] < 60.0
    assert set(result["summary"]["met_rate_by_part"]) == {"pelvis", "chest"}


def test_control_has_all_methods_but_those_of_tokens(data: Path) -> None:
    rows = bench_control(TinyGenerator(), data, 1, (), ("pelvis",), ("1",))["rows"]
    assert [row["method"] for row in rows] == ["uncontrolled", *(m for m in METHODS if m not in OF_TOKENS)]
    assert all(row["passes"] > 1 for row in rows[1:])


def test_an_evaluation_without_tokens_has_no_row_of_them(tmp_path: Path) -> None:
    clips = {f"c{i}": (walk(38 + i % 5, speed=0.8 + 0.03 * i), {"split": "test"}) for i in range(33)}
    folder = write_folder(tmp_path / "data", clips)
    torch.manual_seed(0)
    sizes = EncoderConfig(width=16, depth=1, out=8)
    judge = ContrastiveEvaluator(
        Contrastive(ContrastiveConfig(motion=sizes, text="none", text_dim=6, hidden=8)), Words()
    )
    result = bench_generator(TinyGenerator(), judge, KindClassifier(["run", "walk"], 8, 1), folder, repeats=2)
    assert [row["set"] for row in result["rows"]] == ["real", "generated"]
    assert not {"code_use", "posterior_kl", "fid_reconstruction"} & set(result["summary"])
    page = evaluation_page(result, "default")
    assert "| generated |" in page and "token" not in page and "econstruction" not in page


def test_what_only_tokens_have_is_refused_in_a_sentence(data: Path) -> None:
    with pytest.raises(UserError, match="generator 'tiny' has no token posterior"):
        bench_posterior(TinyGenerator())
    with pytest.raises(UserError, match="generator 'tiny' has no tokenizer"):
        bench_tokenizer(TinyGenerator(), data)
    with pytest.raises(UserError, match="method 'controlmm' draws MSCoT's tokens, and generator 'tiny' has none"):
        bench_control(TinyGenerator(), data, 1, ("adam", "controlmm"), ("pelvis",), ("1",))
