"""Where movement is lost: what loses nothing keeps every band, and the row of all tokens is the old bench."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from scenectl.bench.models.lost import bench_lost
from scenectl.bench.models.tokenizer import bench_tokenizer
from scenectl.data.clips import beginnings, prepare
from scenectl.data.features import on_body
from scenectl.evaluation.kinds import KindClassifier
from scenectl.generators.mscot.coding import after_scales
from scenectl.generators.mscot.sampling import MSCoT
from scenes.errors import UserError
from tests.scenectl.small import SCALES, bundle
from tests.scenectl.tiny import TinyGenerator
from tests.scenectl.training.folder import walks

KINDS = ["walk", "bandai: walk", "bandai: walk-turn-left", "bandai: wave-left-hand"]
OVER_REAL = ("acceleration_over_real", "max_acceleration_over_real", "power_over_real")


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return walks(tmp_path_factory.mktemp("data"))


@pytest.fixture(autouse=True)
def _few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenectl.bench.models.lost.SEEN", 8)


class Parted(MSCoT):
    """Two parts: one loses nothing, and one stands still."""

    def round_trips(self, seen: torch.Tensor) -> dict[str, Callable[[torch.Tensor], torch.Tensor]]:
        return {"nothing lost": on_body, "still": lambda f: f.mean(1, keepdim=True).expand_as(f)}


def test_rows_are_those_of_the_parts_and_the_last_is_the_round_trip_of_old(data: Path) -> None:
    generator = MSCoT(bundle())
    rows = {row["through"]: row for row in bench_lost(generator, KindClassifier(KINDS, 8, 1), data)}
    scales = [f"tokens of {k} scale{'s' if k > 1 else ''}" for k in range(1, len(SCALES) + 1)]
    assert list(rows) == ["real", "16 principal components", "continuous latent", *scales, "all tokens, refined"]
    old = {row["set"]: row for row in bench_tokenizer(generator, data, (64,))["rows"]}
    for source in {"bandai", "other"} & set(old):
        for figure in ("global_error", "local_error"):
            assert rows[scales[-1]][f"{figure}_{source}_m"] == pytest.approx(old[source][f"{figure}_m"], rel=1e-5)
    assert rows["all tokens, refined"]["kept"] != rows[scales[-1]]["kept"]
    json.dumps(rows)


def test_what_loses_nothing_keeps_every_band_and_what_stands_still_none(data: Path) -> None:
    real, same, still = bench_lost(Parted(bundle()), KindClassifier(KINDS, 8, 1), data)
    assert {**same, "through": "real"} == real
    assert all(share == pytest.approx(1.0, abs=1e-4) for share in real["kept"].values())
    assert all(real[name] == 1.0 for name in OVER_REAL) and real["recall_of_waves"] is None  # no test clip waves
    errors = [value for name, value in real.items() if name.endswith("_m") and value is not None]
    assert errors == pytest.approx([0.0] * len(errors), abs=1e-5) and len(errors) in (2, 4)
    assert all(share < 1e-3 for share in still["kept"].values())
    assert still["power_over_real"] < 1e-3 and still["global_error_other_m"] > 0.05


def test_all_scales_are_the_round_trip_and_each_adds_its_own(data: Path, tmp_path: Path) -> None:
    generator = MSCoT(bundle())
    tokenizer, features = generator.bundle.tokenizer, beginnings(prepare(data, ["test"], None, tmp_path, 0), 64)
    after = [after_scales(tokenizer, k + 1)(features) for k in range(len(SCALES))]
    torch.testing.assert_close(after[-1], generator.round_trip(features))
    assert not torch.allclose(after[-2], after[-1])


def test_the_command_prints_it_and_keeps_it(
    data: Path, tmp_path: Path, scenectl: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scenectl.bench.commands.shared.loaded", lambda name, weights: Parted(bundle()))
    said = scenectl("bench", "tokenizer", "--data", data, "--json", tmp_path / "found.json")
    assert said.status == 0 and "where movement is lost" in said.out, said.err
    found = json.loads((tmp_path / "found.json").read_text())
    assert [row["through"] for row in found["lost"]] == ["real", "nothing lost", "still"]
    assert {row["frames"] for row in found["rows"]} == {64} and found["summary"]["reconstruction_error_all_m"] > 0
    assert any(line.startswith("still") for line in said.out.splitlines())


def test_a_generator_without_tokens_is_refused(data: Path) -> None:
    with pytest.raises(UserError, match="generator 'tiny' has no tokenizer"):
        bench_lost(TinyGenerator(), KindClassifier(KINDS, 8, 1), data)
