"""Measures of a model: code use counts codes, bands find the frequency that is wrong, joints the joint."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch

from scenectl.data.features import features_to_joints, joints_to_features
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.mscot.training.measures import (
    BANDS,
    band_rms,
    beginnings,
    code_use,
    error_by_band,
    error_by_joint,
    least_use,
    measure_tokenizer,
)
from scenectl.training.dataset import prepare
from scenes.errors import UserError
from tests.scenectl.small import SCALES, config, walk
from tests.scenectl.training.folder import walks


def model() -> Tokenizer:
    torch.manual_seed(0)
    made = Tokenizer(config().tokenizer)
    rows = joints_to_features(walk(64))
    made.mean.copy_(rows.mean(0))
    made.std.fill_(0.3)
    return made


def test_code_use_is_judged_beyond_the_coarse_scales() -> None:
    use = [{"share_used": share, "perplexity": 9 * share} for share in (0.1, 0.2, 0.3, 0.8, 0.7)]
    assert least_use(use) == 0.7 and least_use(use, "perplexity") == pytest.approx(6.3)
    assert least_use(use[:2]) == 0.2  # of two scales the last


def test_code_use_is_what_counting_by_hand_gives() -> None:
    tokenizer = model()
    features = torch.stack([joints_to_features(walk(65, turn=0.1 * i)) for i in range(70)])
    rows = code_use(tokenizer, features)
    assert [row["scale"] for row in rows] == [1, 2, 3, 4]
    tokens = tokenizer.encode(features)
    for k, row in enumerate(rows):
        seen = tokens[k].flatten().tolist()
        share = [seen.count(code) / len(seen) for code in set(seen)]
        assert row["tokens"] == len(seen) == 70 * tokens[k].shape[1]
        assert row["share_used"] == pytest.approx(len(set(seen)) / 16)
        assert row["perplexity"] == pytest.approx(math.exp(-sum(p * math.log(p) for p in share)), rel=1e-4)
    assert len(rows) == len(SCALES)


@pytest.mark.parametrize("hertz", [0.625, 1.25, 2.5, 5.0])
def test_a_wobble_is_found_in_its_band_with_its_size(hertz: float) -> None:
    still = torch.zeros(2, 64, 22, 3)
    time = torch.arange(64) / 20
    moved = still.clone()
    moved[:, :, 7, 1] = 0.3 + 0.1 * torch.sin(2 * math.pi * hertz * time)  # an offset is no movement
    inside = [low <= hertz < high for low, high in BANDS].index(True)
    rows = error_by_band(moved, still)
    errors = [row["error_rms_m"] for row in rows]
    wanted = 0.1 / math.sqrt(2) / math.sqrt(22)  # one joint of 22
    assert errors[inside] == pytest.approx(wanted, rel=0.1)
    assert sum(e**2 for i, e in enumerate(errors) if i != inside) < 0.25 * errors[inside] ** 2
    assert all(row["true_rms_m"] == 0 and row["reconstructed_rms_m"] == row["error_rms_m"] for row in rows)


def test_bands_share_out_the_mean_square_of_noise() -> None:
    torch.manual_seed(0)
    noise = torch.randn(200, 64, 3, 3)
    total = sum(value**2 for value in band_rms(noise))
    assert total == pytest.approx(3.0, rel=0.05)  # three axes of unit variance, less the mean over time
    widths = [value**2 / (high - low) for value, (low, high) in zip(band_rms(noise)[1:], BANDS[1:], strict=True)]
    assert max(widths) / min(widths) < 1.25


def test_errors_belong_to_the_joint_that_is_wrong() -> None:
    true = walk(40)[None]
    got = true.clone()
    got[..., 15, 0] += 0.2  # the head
    rows = error_by_joint(got, true)
    assert rows["head"] == {"global_error_m": pytest.approx(0.2), "local_error_m": pytest.approx(0.2)}
    assert sum(row["global_error_m"] for row in rows.values()) == pytest.approx(0.2)
    rows = error_by_joint(true + torch.tensor([0.0, 0.1, 0.0]), true)
    assert all(row["global_error_m"] == pytest.approx(0.1) for row in rows.values())
    assert all(row["local_error_m"] == pytest.approx(0.0, abs=1e-6) for row in rows.values())


@torch.no_grad()
def test_a_model_is_measured_on_whole_beginnings(tmp_path: Path) -> None:
    data = walks(tmp_path / "data")
    train, test = (prepare(data, [split], None, tmp_path, 0) for split in ("train", "test"))
    first = beginnings(train, 60)
    assert len(first) == int((train.lengths >= 60).sum()) and first.shape[1:] == (60, 263)
    assert len(beginnings(train, 40, most=2)) == 2
    with pytest.raises(UserError, match="500 frames"):
        beginnings(train, 500)
    tokenizer = model()
    found = measure_tokenizer(tokenizer, train, test)
    got = features_to_joints(tokenizer.decode(tokenizer.encode(beginnings(test, 64))))
    error = (got - features_to_joints(beginnings(test, 64))).norm(dim=-1).mean()
    mean = sum(row["global_error_m"] for row in found["error_by_joint"].values()) / 22
    assert mean == pytest.approx(float(error), rel=1e-4) and found["clips"] == 2
