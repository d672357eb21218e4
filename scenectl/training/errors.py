"""How far reconstructed motions are from the true ones by source, joint and frequency, and the tables of a card."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.data.clips import ClipSet
from scenectl.data.features import FPS, body_joints, features_to_joints, on_body
from scenectl.training.card import table
from scenes.motion.skeleton import HUMANML3D

RoundTrip = Callable[[Float[Tensor, "C T 263"]], Float[Tensor, "C T 263"]]
"""Raw features in, what a model makes of them out."""

Row = Mapping[str, Any]

BANDS = ((0.0, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 10.0))
"""Hz, from the lower bound up to the upper: posture, gait, its harmonics, what is fast. The last ends at Nyquist."""
QUICK = 6.0
"""Hz above which people move little, and trembling networks do."""


@torch.no_grad()
def error_by_source(round_trip: RoundTrip, data: ClipSet, frames: int) -> dict[str, dict[str, float]]:
    """Mean joint error (m) over the first `frames` frames of every clip that is long enough, by source.

    Global error is of world positions; local error of positions relative to the pelvis; drift is the
    pelvis at the last frame.
    """
    rows: dict[str, list[tuple[float, float, float]]] = {}
    for i, start in enumerate(data.starts[:-1].tolist()):
        if int(data.lengths[i]) < frames:
            continue
        got, true = joints_after(round_trip, data.features[start : start + frames][None])
        error = (got - true).norm(dim=-1)
        local = (about_pelvis(got) - about_pelvis(true)).norm(dim=-1)
        row = float(error.mean()), float(local.mean()), float(error[0, -1, 0])
        for key in {data.sources[i], "all", "bandai" if data.sources[i] == "bandai" else "other"}:
            rows.setdefault(key, []).append(row)
    names = "global_error_m", "local_error_m", "root_drift_m"
    return {
        key: {"clips": float(len(values)), **{n: sum(v[i] for v in values) / len(values) for i, n in enumerate(names)}}
        for key, values in sorted(rows.items())
    }


@torch.no_grad()
def joints_after(
    round_trip: RoundTrip, features: Float[Tensor, "C T 263"]
) -> tuple[Float[Tensor, "C T 22 3"], Float[Tensor, "C T 22 3"]]:
    """Joints (canonical, m) of what a model makes of the features, and the true ones, both on rigid bones."""
    got = torch.cat([round_trip(part) for part in features.split(64)])
    return body_joints(got), features_to_joints(on_body(features))


def error_by_joint(got: Float[Tensor, "C T 22 3"], true: Float[Tensor, "C T 22 3"]) -> dict[str, dict[str, float]]:
    """Mean distance (m) of every joint from where it should be, in the world and relative to the pelvis."""
    world = (got - true).norm(dim=-1).mean((0, 1))
    local = (about_pelvis(got) - about_pelvis(true)).norm(dim=-1).mean((0, 1))
    return {
        name: {"global_error_m": float(world[j]), "local_error_m": float(local[j])}
        for j, name in enumerate(HUMANML3D.names)
    }


def error_by_band(got: Float[Tensor, "C T 22 3"], true: Float[Tensor, "C T 22 3"]) -> list[dict[str, float]]:
    """How much each band of frequencies moves, and how much of it is wrong.

    Joints relative to the pelvis, about their mean over the clip.

    Returns:
        For every band its bounds (Hz), the root mean square of the true movement, of the reconstructed one and of
        their difference (m), over joints, frames and clips.
    """
    moves = {"true": about_pelvis(true), "reconstructed": about_pelvis(got)}
    moves["error"] = moves["reconstructed"] - moves["true"]
    found = {name: band_rms(move) for name, move in moves.items()}
    return [
        {"low_hz": low, "high_hz": high, **{f"{name}_rms_m": values[i] for name, values in found.items()}}
        for i, (low, high) in enumerate(BANDS)
    ]


def kept_by_band(got: Float[Tensor, "C T 22 3"], true: Float[Tensor, "C T 22 3"]) -> dict[str, float | None]:
    """How much each band still moves, relative to what it should: 1 where all movement is kept, None where none was."""
    rows = error_by_band(got, true)
    return {
        band_name(row): row["reconstructed_rms_m"] / row["true_rms_m"] if row["true_rms_m"] else None for row in rows
    }


def band_name(row: Row) -> str:
    """As tables call a band of `error_by_band`."""
    return f"{row['low_hz']:g} to {row['high_hz']:g} Hz"


def band_rms(x: Float[Tensor, "C T J 3"], fps: float = FPS) -> list[float]:
    """Root mean square of trajectories in each of `BANDS`, about their mean over time (Hann window)."""
    hertz, power = spectrum(x, fps)
    inside = [(hertz >= low) & (hertz < high) for low, high in BANDS]
    inside[-1] |= hertz >= BANDS[-1][1]
    return [math.sqrt(float(power[mask].sum())) for mask in inside]


def spectrum(x: Float[Tensor, "C T J 3"], fps: float = FPS) -> tuple[Float[Tensor, " F"], Float[Tensor, " F"]]:
    """Frequencies (Hz) and the power at each (m^2), of trajectories about their mean over time (Hann window).

    Mean over clips and joints; all frequencies together have the mean square of a stationary signal.
    """
    frames = x.shape[1]
    window = torch.hann_window(frames, dtype=x.dtype, device=x.device)
    transformed = torch.fft.rfft((x - x.mean(1, keepdim=True)) * window[:, None, None], dim=1)
    # One side of the spectrum stands for both.
    power = 2 * transformed.abs().square().sum(-1).mean((0, 2)) / (frames * window.square().sum())
    return torch.fft.rfftfreq(frames, 1 / fps, device=x.device), power


def power_above(joints: Float[Tensor, "C T 22 3"], low: float, fps: float = FPS) -> float:
    """Mean power (m^2) of what joints do relative to the pelvis at more than `low` Hz: tremor, jerks, quick waves."""
    hertz, power = spectrum(about_pelvis(joints), fps)
    return float(power[hertz > low].sum())


def about_pelvis(joints: Float[Tensor, "C T 22 3"]) -> Float[Tensor, "C T 22 3"]:
    """Joints relative to the pelvis of their frame."""
    return joints - joints[..., :1, :]


def source_table(by_length: Mapping[str, Mapping[str, Row]]) -> list[str]:
    """Lines of a card for `error_by_source`, by number of frames."""
    names = "global_error_m", "local_error_m", "root_drift_m"
    rows = [
        (frames, f"{row['clips']:.0f}", name, *(_mm(row[figure]) for figure in names))
        for frames, sets in by_length.items()
        for name, row in sets.items()
    ]
    return table(("frames", "clips", "set", "global joints", "local joints", "root at the end"), rows)


def joint_table(errors: Mapping[str, Row]) -> list[str]:
    """Lines of a card for `error_by_joint`."""
    rows = ((name.replace("_", " "), _mm(e["global_error_m"]), _mm(e["local_error_m"])) for name, e in errors.items())
    return table(("joint", "global", "local"), rows)


def band_table(bands: Sequence[Row]) -> list[str]:
    """Lines of a card for `error_by_band`."""
    names = "true", "reconstructed", "error"
    rows = ((band_name(row), *(_mm(row[f"{name}_rms_m"], 1) for name in names)) for row in bands)
    return table(("band", "real", "reconstructed", "difference"), rows)


def _mm(metres: float, digits: int = 0) -> str:
    return f"{metres * 1000:.{digits}f} mm"
