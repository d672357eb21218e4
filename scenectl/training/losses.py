"""Reconstruction losses, and the settings of trainings by them alone."""

from __future__ import annotations

from typing import Annotated

import torch
import torch.nn.functional as F
from jaxtyping import Float
from pydantic import Field
from torch import Tensor

from scenectl.data.features import (
    CONTACT_JOINTS,
    CONTACTS,
    ROOT_VELOCITY,
    YAW,
    body_joints,
    features_to_joints,
    on_body,
)
from scenectl.training.loop import LoopSettings
from scenes.motion.skeleton import HUMANML3D
from scenes.tables import Table

_FEET = HUMANML3D.indices(CONTACT_JOINTS)


class ReconstructionWeights(Table):
    """Weights of the reconstruction terms.

    Attributes:
        features: smooth L1 on normalised features.
        root: extra weight of yaw and root velocity, whose errors add up over the clip.
        joints: L1 on global joint positions (m).
        feet: L1 on the displacement of ankles and feet between frames (m).
        velocities: L1 on the displacement of all joints between frames (m).
        contacts: L1 on the displacement of an ankle or foot between frames while the true one stands still (m).
        lift: L1 on the heights of ankles and feet (m); feet that swing too low would count as skating.
        peaks: largest error of any joint's second difference over a clip (m), which shows as a jerk.
        amplitudes: L1 on the amplitudes of what joints do relative to the pelvis (m), summed over the frequencies of
            windows of 1.6 s. Where codes don't tell the phase of a movement, all other terms are least for none at all.
    """

    features: float = 1.0
    root: float = 1.0
    joints: float = 2.0
    feet: float = 10.0
    velocities: float = 0.0
    contacts: float = 0.0
    lift: float = 0.0
    peaks: float = 0.0
    amplitudes: float = 0.0


class ReconstructionTraining(Table):
    """Settings of a training by reconstruction alone.

    Attributes:
        loop: length and speed.
        frames: window lengths, one drawn for each batch.
        reconstruction: weights of the reconstruction terms.
        misread: largest share of a window's tokens that are others nearby. A generator draws many tokens at once, which
            do not quite agree; what they are decoded to shall not slide for it.
    """

    loop: LoopSettings
    frames: tuple[int, ...] = (64,)
    reconstruction: ReconstructionWeights = ReconstructionWeights()
    misread: Annotated[float, Field(ge=0, le=1)] = 0.0


def reconstruction_loss(
    got: Float[Tensor, "B T 263"],
    wanted: Float[Tensor, "B T 263"],
    std: Float[Tensor, "263"],
    weights: ReconstructionWeights,
) -> tuple[Float[Tensor, ""], Float[Tensor, ""]]:
    """The loss, and the mean global joint error in metres, of raw features.

    Both are on a generated body's rigid bones: what is wanted by `on_body`, what came out by the map that decoders are
    followed by.
    """
    wanted = on_body(wanted)
    error = F.smooth_l1_loss(got / std, wanted / std, reduction="none", beta=0.5)
    root = error[..., YAW].mean() + error[..., ROOT_VELOCITY].mean()
    joints, true = body_joints(got), features_to_joints(wanted)
    difference = joints - true
    steps = difference.diff(dim=-3).abs()
    feet = steps[..., _FEET, :].mean()
    loss = (
        weights.features * error.mean()
        + weights.root * root
        + weights.joints * difference.abs().mean()
        + weights.feet * feet
    )
    if weights.velocities:
        loss = loss + weights.velocities * steps.mean()
    if weights.contacts:
        sliding = joints[..., _FEET, :].diff(dim=-3).abs().mean(-1)
        stands = (wanted[..., :-1, CONTACTS] > 0.5).to(sliding)
        loss = loss + weights.contacts * (sliding * stands).sum() / stands.sum().clamp_min(1.0)
    if weights.lift:
        loss = loss + weights.lift * difference[..., _FEET, 1].abs().mean()
    if weights.peaks:
        loss = loss + weights.peaks * difference.diff(n=2, dim=-3).norm(dim=-1).amax(dim=(-2, -1)).mean()
    if weights.amplitudes:
        amplitudes = _amplitudes(joints) - _amplitudes(true)
        loss = loss + weights.amplitudes * amplitudes.abs().sum(-2).mean()
    return loss, difference.detach().norm(dim=-1).mean()


_WINDOW, _HOP = 32, 8


def _amplitudes(joints: Float[Tensor, "B T 22 3"]) -> Float[Tensor, "N F W"]:
    """Amplitude (m) of every frequency but zero in windows of the tracks of all coordinates about the pelvis."""
    tracks = (joints - joints[..., :1, :]).flatten(2).transpose(1, 2).flatten(0, 1)
    window = torch.hann_window(_WINDOW, dtype=tracks.dtype, device=tracks.device)
    spectrum = torch.stft(tracks, _WINDOW, _HOP, window=window, center=False, return_complex=True)[:, 1:]
    power = spectrum.real.square() + spectrum.imag.square()
    return 2 / window.sum() * (power + 1e-8).sqrt()  # not abs(), whose gradient at zero is none
