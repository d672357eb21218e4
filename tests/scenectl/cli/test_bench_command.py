"""`scenectl bench`: results as JSON, generators by name, shards of one bench."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from scenectl.evaluation.kinds import ACTS, KindClassifier
from scenectl.networks.checkpoint import save_weights
from tests.scenectl.small import walk
from tests.scenectl.training.folder import walks, write_folder


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return walks(tmp_path_factory.mktemp("data"))


@pytest.fixture
def keyframes(scenectl: Callable, data: Path, tmp_path: Path, tiny_generator: None) -> Callable:
    """Two clips, one keyframe each, by the tiny generator; returns what was said and what was written."""
    file = tmp_path / "found.json"

    def run(*options: object) -> tuple:
        said = scenectl("bench", "keyframes", "--data", data, "--clips", 2, "--keyframes", 1, "--json", file, *options)
        return said, json.loads(file.read_text()) if file.is_file() else None

    return run


def test_a_result_is_printed_and_written(keyframes: Callable, tmp_path: Path) -> None:
    said, found = keyframes()
    assert said.status == 0 and "average_error_m" in said.out and "wrote" in said.out
    assert found["summary"]["clips"] == len(found["rows"]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["found.json"]  # rows that were kept are gone


def test_several_generators_are_told_apart(keyframes: Callable) -> None:
    said, found = keyframes("--generator", "one", "--generator", "two")
    assert said.status == 0 and list(found["summary"]) == ["one", "two"]
    assert [row["generator"] for row in found["rows"]] == ["one", "one", "two", "two"]
    assert found["summary"]["one"]["average_error_m"] == found["summary"]["two"]["average_error_m"]


def test_shards_come_together(keyframes: Callable) -> None:
    _, whole = keyframes()
    _, part = keyframes("--shard", "0/2")
    assert part["summary"] == {"cases_left": 1} and len(part["rows"]) == 1
    keyframes("--shard", "1/2")
    said, found = keyframes()
    assert said.status == 0 and [row["joint"] for row in found["rows"]] == [row["joint"] for row in whole["rows"]]
    assert found["rows"][0] == part["rows"][0]  # seconds, too: it was not measured again


def test_evaluations_of_several_generators_are_told_apart(
    scenectl: Callable, tiny_generator: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scenectl.bench.models.generator.PIECES", 2)
    monkeypatch.setattr("scenectl.bench.models.generator.MULTIMODAL", (2, 2))
    clips = {f"c{i}": (walk(40 + i % 5, speed=0.8 + 0.03 * i), {"split": "test"}) for i in range(33)}
    folder, file = write_folder(tmp_path / "data", clips), tmp_path / "found.json"
    second = KindClassifier(["walk"], 8, 1)
    save_weights(second, tmp_path / ACTS, {"config": second.config})
    one = ("bench", "generator", "--data", folder, "--repeats", 2, "--acts", tmp_path, "--generator", "one")
    two = (*one, "--generator", "two")
    said = scenectl(*two, "--json", file)
    assert said.status == 0 and "evaluator: own" in said.out and "recall by kind of two" in said.out
    assert "believable, of prompts that ask for no scene" in said.out
    found = json.loads(file.read_text())
    assert [(row["generator"], row["set"]) for row in found["rows"][1:3]] == [("one", "generated"), ("two", "real")]
    assert found["summary"]["one"] == found["summary"]["two"] and set(found["kinds"]) == {"one", "two"}
    said = scenectl(*two, "--page", tmp_path / "page.md")
    assert said.status == 2 and "--plot and --page show one generator" in said.err
    said = scenectl(*two, "--against", "default")
    assert said.status == 2 and "--against compares weights of one generator" in said.err
    said = scenectl("bench", "sentences", "--data", folder, "--acts", tmp_path, "--generator", "one")
    assert said.status == 2 and "the classifier knows no kind of act" in said.err


def test_mistakes_are_answered_in_a_sentence(keyframes: Callable, scenectl: Callable, data: Path) -> None:
    for shard, word in (("two", "I/N"), ("2/2", "count shards from 0")):
        said, _ = keyframes("--shard", shard)
        assert said.status == 2 and word in said.err and "Traceback" not in said.err
    said = scenectl("bench", "tokenizer", "--data", data, "--generator", "tiny")
    assert said.status == 2 and "generator 'tiny' has no tokenizer to measure" in said.err
    said = scenectl("bench", "ablations", "--output", data / "out", "--generator", "tiny")
    assert said.status == 2 and "generator 'tiny' has none of its parts" in said.err
