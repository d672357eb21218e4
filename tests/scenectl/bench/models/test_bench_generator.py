"""The whole evaluation on an untrained model and on walks written as formulas."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch

from scenectl.bench.models.generator import asks_for_scene, bench_generator, plot, recall_table
from scenectl.bench.models.page import evaluation_page
from scenectl.data.clips import prepare
from scenectl.data.features import joints_to_features
from scenectl.evaluation.contrastive import Contrastive, ContrastiveConfig, ContrastiveEvaluator
from scenectl.evaluation.kinds import Confusion, KindClassifier
from scenectl.evaluation.motions import EncoderConfig
from scenectl.evaluation.sets import HeldOut, MotionSet, generated, real, reconstructed
from scenectl.generators.mscot.sampling import MSCoT
from scenes.errors import UserError
from tests.scenectl.small import Words, bundle, walk
from tests.scenectl.training.folder import write_folder

KEYS = {
    "reconstruction_error_m", "reconstruction_error_other_m", "code_use", "skating_ratio", "skating_ratio_real",
    "max_acceleration_m_per_frame2", "max_acceleration_real_m_per_frame2", "fid", "fid_reconstruction",
    "fid_random_tokens", "r_precision_top3", "r_precision_top3_real", "label_recall", "label_recall_real",
    "posterior_kl", "root_drift_m", "root_drift_other_m", "worst_kind", "bone_length_drift_m", "limb_ends_moved_m",
    "acceleration_m_per_s2", "acceleration_real_m_per_s2", "skating_over_real", "acceleration_over_real",
    "max_acceleration_over_real", "power_over_real", "fid_other_weights", "believable", "believable_real",
    "worst_ratio", "worst_ratio_kind",
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Thirty-three test clips of two kinds, and one to train on that is long enough to count codes."""
    clips: dict[str, tuple[torch.Tensor, dict[str, object]]] = {"t": (walk(70), {})}
    for i in range(33):
        about: dict[str, object] = {"split": "test", "label": "walk" if i % 2 else "run"}
        clips[f"c{i}"] = walk(66 if i == 0 else 38 + i % 5, speed=0.8 + 0.03 * i), about
    return write_folder(tmp_path_factory.mktemp("data"), clips)


@pytest.fixture(scope="module")
def result(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SCENECTL_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.setattr("scenectl.bench.models.generator.PIECES", 2)
        patch.setattr("scenectl.bench.models.generator.MULTIMODAL", (4, 3))
        torch.manual_seed(0)
        sizes = EncoderConfig(width=16, depth=1, out=8)
        model = Contrastive(ContrastiveConfig(motion=sizes, text="none", text_dim=6, hidden=8))
        judge = ContrastiveEvaluator(model, Words())
        classifier = KindClassifier(["run", "walk"], 8, 1)
        second = KindClassifier(["run", "walk", "crouch"], 8, 1)
        other = MSCoT(bundle(1))
        return bench_generator(
            MSCoT(bundle()), judge, classifier, folder, repeats=3, seeds=2, acts=second, against=other
        )


def test_the_summary_has_what_was_asked_for(result: dict[str, Any]) -> None:
    assert set(result["summary"]) == KEYS
    assert result["summary"]["reconstruction_error_other_m"] > 0
    assert result["summary"]["bone_length_drift_m"] < 1e-4 < result["summary"]["limb_ends_moved_m"]
    assert 0 < result["summary"]["code_use"] <= 1
    json.dumps(result)  # nothing in it that JSON has no word for


def test_every_set_is_scored_alike_and_real_motions_are_their_own_measure(result: dict[str, Any]) -> None:
    rows = {row["set"]: row for row in result["rows"]}
    assert list(rows) == ["real", "reconstruction", "random tokens", "generated", "other weights"]
    assert len(result["rows"]) == 6 and len({tuple(row) for row in result["rows"]}) == 1
    assert rows["real"]["fid"] == pytest.approx(0.0, abs=1e-6)
    first, second = (row for row in result["rows"] if row["set"] == "generated")
    assert first["fid"] > 0 and first["multimodality"] > 0 and second["multimodality"] is None
    assert first["fid"] != second["fid"] != rows["other weights"]["fid"]
    for name in ("fid", "skating_ratio", "acceleration_m_per_s2", "label_recall"):
        assert result["summary"][name] == pytest.approx((first[name] + second[name]) / 2)
    assert rows["real"]["floor_penetration_m"] == pytest.approx(0.0, abs=1e-4)
    assert result["kinds"]["real"]["macro_recall"] == rows["real"]["label_recall"]
    assert sum(map(sum, result["kinds"]["generated"]["confusion"])) == 2 * result["clips"] == 66


def test_recall_is_over_that_on_real_motions_and_acts_are_looked_for_in_pieces_too(result: dict[str, Any]) -> None:
    assert [(row["kind"], row["clips"]) for row in result["recall"]] == [("run", 17), ("walk", 16)]
    acts = {row["kind"]: row for row in result["recall_of_acts"]}
    assert acts["run"]["of"] == "recordings" and acts["run"]["clips"] == 17
    edits = [row for row in acts.values() if row["of"] != "recordings" or row["kind"].startswith("rarer")]
    assert edits and all(row["clips"] > 0 for row in edits)  # of test clips


def test_rare_kinds_share_a_row_unless_they_are_asked_for() -> None:
    truth = Confusion.of(["a"] * 10 + ["b"] * 4 + ["c"] * 2, ["a"] * 10 + ["b"] * 3 + ["a"] + ["b"] * 2)
    made = Confusion.of(["a"] * 10 + ["b"] * 4 + ["c"] * 2, ["a"] * 5 + ["b"] * 5 + ["b"] * 4 + ["c"] * 2)
    rows = {row["kind"]: row for row in recall_table(truth, made)}
    assert rows["a"] == {"kind": "a", "clips": 10, "real": 1.0, "generated": 0.5, "ratio": 0.5}
    assert rows["rarer (2 kinds)"]["real"] == 0.5 and rows["rarer (2 kinds)"]["ratio"] == 2.0
    assert set(recall_table(truth, made, ["c"])[1]) and {"a", "c", "rarer (1 kinds)"} == {
        row["kind"] for row in recall_table(truth, made, ["c"])
    }
    (c,) = (row for row in recall_table(truth, made, ["c"]) if row["kind"] == "c")
    assert c["ratio"] is None  # never recognised on real motions


def test_criteria_tell_what_was_wanted_and_got(result: dict[str, Any]) -> None:
    found = {row["criterion"]: row for row in result["criteria"]}
    assert found["second classifier, over real: sit down"]["got"] is None
    assert not found["second classifier, over real: sit down"]["met"]
    for row in result["criteria"]:
        low, high = (0.8, 1.1) if " to " in row["wanted"] else (0.0, float(row["wanted"].split()[-1]))
        if row["wanted"].startswith("at least"):
            low, high = high, float("inf")
        assert row["met"] == (row["got"] is not None and low <= row["got"] <= high)


@pytest.mark.parametrize(
    ("kind", "caption", "asks"),
    [
        ("walk", "a person walks forward.", False),
        ("walk", "a person walks up the stairs.", True),
        ("sit", "a person waits.", True),
        ("bandai: bow", "A person bows, then steps back.", False),
        ("other", "someone Sits down on a chair", True),
    ],
)
def test_prompts_that_need_more_than_a_floor_are_told(kind: str, caption: str, asks: bool) -> None:
    assert asks_for_scene(kind, caption) == asks


def test_the_page_has_every_set_and_kind_and_no_figure_that_the_result_lacks(result: dict[str, Any]) -> None:
    page = evaluation_page(result, "default", Path("kinds.png"))
    lines = page.splitlines()
    for name in ("real", "reconstruction", "random tokens", "generated"):
        assert sum(line.startswith(f"| {name} |") for line in lines) == 3 * (1 + (name == "generated"))
    recall = result["kinds"]["generated"]["recall"]
    for kind, share in recall.items():
        line = next(line for line in lines if line.startswith(f"| {kind} |"))
        assert line.endswith(f"| {share:.2f} |")
    for row in result["criteria"]:
        assert sum(line.startswith(f"| {row['criterion']} | {row['wanted']} |") for line in lines) == 1
    assert "## Acts" in lines and "edits of test clips" in page
    assert "![confusion of kinds](kinds.png)" in page
    assert f"{result['summary']['label_recall']:.3f} on generated ones" in page
    assert "confusion of kinds" not in evaluation_page(result, "default")


def test_confusion_is_drawn(result: dict[str, Any], tmp_path: Path) -> None:
    plot(result, tmp_path / "kinds.png")
    assert (tmp_path / "kinds.png").stat().st_size > 5000


def test_motions_keep_their_clips_lengths_and_a_set_can_be_bounded(folder: Path, tmp_path: Path) -> None:
    windows = prepare(folder, ["test"], None, tmp_path, 0)
    clips = HeldOut.of(windows, MSCoT.spec, seed=0, most=4)
    assert len(clips.captions) == 4 and all(len(f) % 4 == 0 and len(f) >= 36 for f in clips.features)
    generator = MSCoT(bundle())
    made = generated(clips, generator, 0)
    for motions in (real(clips), reconstructed(clips, generator.round_trip), made):
        assert [len(j) for j in motions.joints] == [len(f) for f in clips.features]
        assert [len(f) + 1 for f in motions.features] == [len(f) for f in clips.features]


def test_features_of_a_set_come_from_its_joints() -> None:
    joints = walk(44)
    made = MotionSet.of("x", [joints])
    torch.testing.assert_close(made.features[0], joints_to_features(joints))
    assert made.padded.valid.all()


def test_clips_too_short_are_refused(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "d", {"a": (walk(20), {"split": "test"})})
    with pytest.raises(UserError, match="no test clip has 36 frames"):
        HeldOut.of(prepare(folder, ["test"], None, tmp_path / "c", 0), MSCoT.spec, 0)


def test_what_cannot_be_scored_is_found_before_anything_is_generated(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("motions were made for nothing")

    monkeypatch.setenv("SCENECTL_CACHE", str(tmp_path))
    monkeypatch.setattr("scenectl.bench.models.generator.generated", never)
    sizes = EncoderConfig(width=16, depth=1, out=8)
    judge = ContrastiveEvaluator(Contrastive(ContrastiveConfig(motion=sizes, text="none", text_dim=6)), Words())
    with pytest.raises(UserError, match="ranks among 32 motions and there are 20"):
        bench_generator(MSCoT(bundle()), judge, KindClassifier(["run", "walk"], 8, 1), folder, clips=20)

    def mute(captions: object) -> torch.Tensor:
        raise UserError("no words for it")

    monkeypatch.setattr(judge, "embed_texts", mute)
    with pytest.raises(UserError, match="no words for it"):
        bench_generator(MSCoT(bundle()), judge, KindClassifier(["run", "walk"], 8, 1), folder)
