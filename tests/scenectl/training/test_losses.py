"""Reconstruction losses: each term by itself, and what amplitudes look past."""

from __future__ import annotations

import pytest
import torch
import torch.nn.functional as F

from scenectl.data.features import body_joints, features_to_joints, joints_to_features, on_body
from scenectl.training.losses import ReconstructionWeights, _amplitudes, reconstruction_loss
from tests.scenectl.small import walk


def test_the_reconstruction_loss_is_its_terms() -> None:
    wanted = on_body(joints_to_features(walk(40))[None].double())
    std = torch.rand(263, dtype=torch.float64) + 0.5
    got = wanted + 0.1 * torch.randn_like(wanted)
    difference = body_joints(got) - features_to_joints(wanted)
    smooth = F.smooth_l1_loss(got / std, wanted / std, reduction="none", beta=0.5)
    feet = difference[:, :, [7, 10, 8, 11]]
    terms = {
        "features": smooth.mean(),
        "root": smooth[..., 0].mean() + smooth[..., 1:3].mean(),
        "joints": difference.abs().mean(),
        "feet": (feet[:, 1:] - feet[:, :-1]).abs().mean(),
        "velocities": (difference[:, 1:] - difference[:, :-1]).abs().mean(),
        "lift": feet[..., 1].abs().mean(),
        "peaks": (difference[0, 2:] - 2 * difference[0, 1:-1] + difference[0, :-2]).norm(dim=-1).max(),
        "amplitudes": 2 / 16 * (spectra(got) - spectra(wanted)).abs().sum(-2).mean(),
        "contacts": sliding(body_joints(got)[:, :, [7, 10, 8, 11]], wanted[..., 259:263] > 0.5),
    }
    silent = dict.fromkeys(terms, 0.0)
    for name, value in terms.items():
        loss, error = reconstruction_loss(got, wanted, std, ReconstructionWeights(**{**silent, name: 3.0}))
        torch.testing.assert_close(loss, 3 * value)
        torch.testing.assert_close(error, difference.norm(dim=-1).mean())
    perfect, error = reconstruction_loss(wanted, wanted, std, ReconstructionWeights())
    assert float(perfect) < 1e-6 and float(error) < 1e-6  # the map is exact to its shortest bone


def spectra(features: torch.Tensor) -> torch.Tensor:
    """Moduli, never quite zero, of all coordinates' Fourier components about the pelvis, window by window."""
    joints = body_joints(features)
    tracks = (joints - joints[:, :, :1])[0].flatten(1)
    window = torch.hann_window(32, dtype=tracks.dtype)[:, None]
    pieces = [torch.fft.rfft(tracks[t : t + 32] * window, dim=0)[1:] for t in range(0, len(tracks) - 31, 8)]
    return (torch.stack(pieces).abs().square() + 1e-8).sqrt()


def test_amplitudes_care_for_how_much_a_joint_moves_and_not_for_when() -> None:
    """A wave half a period late costs nothing; one that is averaged away costs its amplitude."""
    time = torch.arange(64, dtype=torch.float64)
    wave = 0.1 * torch.sin(2 * torch.pi * time / 8)
    still = torch.zeros(1, 64, 22, 3, dtype=torch.float64)
    waving, late = still.clone(), still.clone()
    waving[0, :, 21, 0], late[0, :, 21, 0] = wave, -wave
    assert float((_amplitudes(waving) - _amplitudes(late)).abs().max()) < 1e-12
    assert float((_amplitudes(waving) - _amplitudes(still)).amax()) == pytest.approx(0.1, abs=2e-4)
    (gradient,) = torch.autograd.grad(_amplitudes(still.requires_grad_(True)).sum(), still)
    assert bool(gradient.isfinite().all())


def sliding(feet: torch.Tensor, stands: torch.Tensor) -> torch.Tensor:
    """Mean displacement along an axis over the frames at which the true foot stands, one by one."""
    steps = [
        (feet[0, t + 1, j] - feet[0, t, j]).abs().mean()
        for t in range(feet.shape[1] - 1)
        for j in range(4)
        if stands[0, t, j]
    ]
    assert len(steps) > 20
    return torch.stack(steps).mean()
