"""Measures of a tokenizer: code use counts codes, errors are those of a pass through it."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch

from scenectl.data.clips import beginnings, prepare
from scenectl.data.features import body_joints, features_to_joints, joints_to_features, on_body
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.mscot.training.measures import (
    code_use,
    least_use,
    measure_tokenizer,
)
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


@torch.no_grad()
def test_a_model_is_measured_on_whole_beginnings(tmp_path: Path) -> None:
    data = walks(tmp_path / "data")
    train, test = (prepare(data, [split], None, tmp_path, 0) for split in ("train", "test"))
    tokenizer = model()
    found = measure_tokenizer(tokenizer, train, test)
    got = body_joints(tokenizer.decode(tokenizer.encode(beginnings(test, 64))))
    error = (got - features_to_joints(on_body(beginnings(test, 64)))).norm(dim=-1).mean()
    mean = sum(row["global_error_m"] for row in found["error_by_joint"].values()) / 22
    assert mean == pytest.approx(float(error), rel=1e-4) and found["clips"] == 2
    whole = [row["reconstructed_rms_m"] / row["true_rms_m"] for row in found["error_by_band"]]
    assert list(found["kept_by_scales"][-1].values()) == pytest.approx(whole, rel=1e-4)
    assert len(found["kept_by_scales"]) == len(SCALES)
