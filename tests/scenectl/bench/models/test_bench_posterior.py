"""The bench of token posteriors on an untrained model of a few codes."""

from __future__ import annotations

import pytest

from scenectl.bench.models.posterior import bench_posterior
from scenectl.generators.mscot.sampling import MSCoT, Sampling
from scenes.errors import UserError
from tests.scenectl.small import bundle
from tests.scenectl.tiny import TinyGenerator


def test_both_posteriors_agree_where_the_clip_leaves_no_tilt() -> None:
    narrow, wide = (
        bench_posterior(MSCoT(bundle(), Sampling(clip_nats=clip)), generations=1)["summary"] for clip in (1e-4, 1e4)
    )
    assert narrow["kl_nats"] == pytest.approx(0, abs=1e-4)
    assert wide["kl_nats"] == pytest.approx(wide["kl_unclipped_nats"], rel=1e-4)
    assert narrow["kl_unclipped_nats"] > narrow["kl_nats"]


def test_rows_carry_the_positions_of_their_scale() -> None:
    generator = MSCoT(bundle())
    result = bench_posterior(generator, generations=2)
    lengths = generator.quantiser.lengths(16)
    assert [row["positions"] for row in result["rows"]] == list(lengths)
    mean = sum(row["kl_nats"] * row["positions"] for row in result["rows"]) / sum(lengths)
    assert result["summary"]["kl_nats"] == pytest.approx(mean)


def test_generators_without_codes_are_refused() -> None:
    with pytest.raises(UserError, match="no token posterior"):
        bench_posterior(TinyGenerator())
