"""Metrics on embeddings, against what is known without them."""

from __future__ import annotations

import math

import pytest
import torch

from scenectl.evaluation.metrics import (
    diversity,
    frechet_distance,
    multimodal_distance,
    multimodality,
    r_precision,
    repeated,
)
from scenes.errors import UserError


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def normal(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=seeded(seed), dtype=torch.float64)


def test_the_frechet_distance_of_gaussians_that_are_known() -> None:
    a = normal(40, 5)
    assert frechet_distance(a, a) == pytest.approx(0.0, abs=1e-9)
    shift = torch.tensor([3.0, 0, 4.0, 0, 0], dtype=torch.float64)
    assert frechet_distance(a, a + shift) == pytest.approx(25.0)
    # Scaling by s about the mean changes the trace term by (s - 1)^2 tr(A).
    centred = a - a.mean(0)
    assert frechet_distance(centred, 3 * centred) == pytest.approx(4 * float(torch.cov(a.T).trace()))
    turn = torch.linalg.qr(normal(5, 5, seed=1)).Q
    b = normal(60, 5, seed=2) * 2 + 1
    assert frechet_distance(a, b) == pytest.approx(frechet_distance(b, a), rel=1e-9)
    assert frechet_distance(a @ turn, b @ turn) == pytest.approx(frechet_distance(a, b), rel=1e-9)


def test_fewer_samples_than_dimensions_give_a_finite_distance() -> None:
    few, more = normal(6, 40), normal(200, 40, seed=1)
    assert math.isfinite(frechet_distance(few, more)) and frechet_distance(few, few) == pytest.approx(0.0, abs=1e-6)
    with pytest.raises(UserError, match="two motions"):
        frechet_distance(few[:1], more)


def test_r_precision_of_perfect_and_of_random_pairs() -> None:
    texts = normal(320, 16)
    assert r_precision(texts, texts, seeded()).tolist() == [1.0, 1.0, 1.0]
    chance = torch.stack([r_precision(texts, normal(320, 16, seed=s), seeded(s)) for s in range(1, 40)]).mean(0)
    torch.testing.assert_close(chance, torch.tensor([1 / 32, 2 / 32, 3 / 32]), atol=0.01, rtol=0)
    assert r_precision(texts, -texts, seeded())[0] == 0.0


def test_a_collapsed_evaluator_scores_nothing() -> None:
    same = torch.ones(64, 4)
    assert r_precision(same, same, seeded()).tolist() == [0.0, 0.0, 0.0]


def test_batches_are_of_32_and_an_incomplete_one_is_dropped() -> None:
    texts = normal(63, 8)
    shares = r_precision(texts, normal(63, 8, seed=1), seeded())
    assert torch.equal((shares * 32).round(), shares * 32)
    with pytest.raises(UserError, match="there are 31"):
        r_precision(texts[:31], texts[:31], seeded())


def test_distances_of_pairs() -> None:
    corners = torch.eye(8) / math.sqrt(2)  # any two are at distance 1
    assert diversity(corners, seeded()) == pytest.approx(1.0)
    assert multimodality(corners.expand(3, 8, 8), seeded()) == pytest.approx(1.0)
    assert multimodality(torch.ones(4, 5, 2), seeded()) == 0.0
    assert multimodal_distance(corners, corners + torch.tensor([2.0] + [0.0] * 7)) == pytest.approx(2.0)


def test_intervals_shrink_with_repeats() -> None:
    def figure(draw: torch.Generator) -> float:
        return float(torch.randn((), generator=draw))

    few, many = repeated(figure, 20, 0), repeated(figure, 2000, 0)
    assert many.interval == pytest.approx(1.96 / math.sqrt(2000), rel=0.1)
    assert few.interval > 5 * many.interval and abs(many.mean) < 3 * many.interval
    assert repeated(lambda draw: 2.0, 20, 0).interval == 0.0
