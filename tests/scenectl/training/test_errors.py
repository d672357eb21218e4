"""Errors of reconstruction: bands find the frequency that is wrong, joints the joint, and sources theirs."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch

from scenectl.data.clips import prepare
from scenectl.data.features import on_body
from scenectl.training.errors import BANDS, band_rms, error_by_band, error_by_joint, error_by_source
from tests.scenectl.small import walk
from tests.scenectl.training.folder import walks


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


def test_reconstruction_errors_are_what_they_are_called(tmp_path: Path) -> None:
    clips = prepare(walks(tmp_path / "data"), ["train"], None, tmp_path, 0)

    def raised(features: torch.Tensor) -> torch.Tensor:
        """Raises every clip by 10 cm, and makes nothing else wrong."""
        moved = on_body(features)
        moved[..., 3] += 0.1
        moved[..., 5:67:3] += 0.1
        return moved

    got = error_by_source(raised, clips, 52)
    assert (
        got["all"]["clips"] == 4 and got["bandai"]["clips"] == 2 and got["other"]["clips"] == got["cmu"]["clips"] == 2
    )
    for row in got.values():
        assert row["global_error_m"] == pytest.approx(0.1, abs=1e-5)
        assert row["local_error_m"] == pytest.approx(0.0, abs=1e-5)
        assert row["root_drift_m"] == pytest.approx(0.1, abs=1e-5)
