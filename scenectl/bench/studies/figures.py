"""Pictures of what a model does inside: scales, guidance, codes (the paper's Fig. 5 to 9)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from objectives import Context, Objective, Term
from scenectl.data.clips import ClipSet, beginnings
from scenectl.data.features import FPS, features_to_joints
from scenectl.generators.base import Guide
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.mscot.posterior import Scale, tilted
from scenectl.generators.mscot.sampling import MSCoT
from scenectl.generators.mscot.training.measures import code_use
from scenectl.pipeline.generation import make
from scenectl.view.strips import draw_strips
from scenes.body.body import DEFAULT_BODY
from scenes.errors import UserError
from scenes.files import atomic_write
from scenes.motion.motion import Motion, Pose2D
from scenes.world.scene import Scene

_SPAN = 32
"""Frames of the window under each column of the spectrogram: 1.6 s, so lines 0.6 Hz apart."""
_FLOOR_DB = -40.0
_PROMPT, _SECONDS = "a person walks forward", 6.0
_BLUE, _RED, _GREY = "#2f6fb0", "#c0392b", "#9a9a9a"


@torch.no_grad()
def draw_spectrogram(tokenizer: Tokenizer, test: ClipSet, png: Path) -> None:
    """Energy of joint velocities over time and frequency, decoded from ever more scales, beside the real clip (Fig. 5).

    The clip is the first of the split, four seconds long or more, whose caption speaks of walking or running.

    Args:
        tokenizer: whose scales are shown.
        test: held-out clips.
        png: the picture, written whole or not at all.

    Raises:
        UserError: no clip is long enough.
    """
    caption, features = _travelling(test)
    tokens = tokenizer.eval().encode(features)
    quantiser, finest = tokenizer.quantiser, tokens[-1].shape[-1]
    codes = [quantiser.lookup(k, t) for k, t in enumerate(tokens)]
    panels = {
        f"scales 1 to {k + 1}" if k else "scale 1": tokenizer.decode_latent(quantiser.latent(codes[: k + 1], finest))
        for k in range(quantiser.scales)
    } | {"real": features}
    energy = {name: spectrogram(features_to_joints(x)[0]) for name, x in panels.items()}
    loudest = max(float(e.max()) for e in energy.values())
    columns = math.ceil(len(energy) / 2)
    figure = _figure(2.1 * columns, 4.6)
    axes = figure.subplots(2, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for axis in axes[len(energy) :]:
        axis.axis("off")
    seconds = features.shape[1] / FPS
    image = None
    for axis, (name, e) in zip(axes, energy.items(), strict=False):
        decibels = (10 * torch.log10(e / loudest + 1e-12)).clamp_min(_FLOOR_DB)
        image = axis.imshow(
            decibels.T.numpy(), origin="lower", aspect="auto", extent=(0, seconds, 0, FPS / 2),
            vmin=_FLOOR_DB, vmax=0, cmap="magma",
        )  # fmt: skip
        axis.set_title(name, fontsize=9)
    for axis in axes[columns:]:
        axis.set_xlabel("seconds", fontsize=8)
    for axis in axes[::columns]:
        axis.set_ylabel("Hz", fontsize=8)
    figure.colorbar(image, ax=list(axes), label="energy of joint velocities (dB)", fraction=0.03)
    figure.suptitle(f"“{caption}”", fontsize=9)
    _save(figure, png)


def spectrogram(joints: Float[Tensor, "T J 3"]) -> Float[Tensor, "S H"]:
    """Energy of joint velocities, summed over joints and axes, at every second frame and each frequency up to 10 Hz."""
    velocity = joints.diff(dim=0).flatten(1) * FPS
    pieces = velocity.unfold(0, _SPAN, 2)  # [S, J 3, _SPAN]
    return torch.fft.rfft(pieces * torch.hann_window(_SPAN)).abs().square().sum(1)


def _travelling(test: ClipSet) -> tuple[str, Tensor]:
    long = [i for i, n in enumerate(test.lengths.tolist()) if n >= 80]
    if not long:
        raise UserError("no test clip of four seconds to draw a spectrogram of; add longer clips")
    moving = [i for i in long if any(word in test.captions[i][0] for word in ("walk", "run"))]
    clip = (moving or long)[0]
    frames = min(int(test.lengths[clip]), MSCoT.spec.window_frames) // 4 * 4
    start = int(test.starts[clip])
    return test.captions[clip][0], test.features[start : start + frames][None]


def draw_code_use(tokenizer: Tokenizer, test: ClipSet, png: Path) -> None:
    """Share of the codes that each scale uses on held-out clips, and how evenly (Fig. 7)."""
    features = beginnings(test, 64)
    rows, codes = code_use(tokenizer, features), tokenizer.config.codes
    figure = _figure(6.4, 3.2)
    axis = figure.subplots()
    at = [row["scale"] for row in rows]
    axis.bar(at, [100 * row["share_used"] for row in rows], color=_BLUE, width=0.7, label="codes used")
    even = [100 * row["perplexity"] / codes for row in rows]
    axis.plot(at, even, color=_RED, marker="o", linewidth=1.2, label="perplexity")
    # No scale can use more codes than it has tokens.
    most = [100 * min(1.0, row["tokens"] / codes) for row in rows]
    axis.step(
        [0.5, *[x + 0.5 for x in at]], [most[0], *most], color=_GREY, linewidth=0.8, label="most that tokens allow"
    )
    axis.set(xlabel="scale", ylabel=f"% of {codes} codes", xticks=at, ylim=(0, 104), xlim=(0.4, len(rows) + 0.6))
    axis.set_title(f"{len(features)} test clips, first 64 frames", fontsize=9)
    figure.legend(fontsize=8, loc="outside lower center", ncols=3)
    axis.grid(axis="y", alpha=0.3)
    _save(figure, png)


@dataclass(frozen=True)
class Guided:
    """One guided generation, scale by scale.

    Attributes:
        scales: each before its tokens were drawn.
        tilts: log-likelihood of the goals for every code, to first order, ``[1, L_k, V]``.
        posteriors: log-probabilities after it, ``[1, L_k, V]``.
        expected: motion decoded from each scale's expected embedding after guidance, the coarser scales drawn.
        finished: the motion after refinement.
        keyframes: seconds of the pelvis targets, and the targets (m, world).
    """

    scales: list[Scale]
    tilts: list[Tensor]
    posteriors: list[Tensor]
    expected: list[Motion]
    finished: Motion
    keyframes: tuple[list[float], Float[Tensor, "K 3"]]


def guided_scales(generator: MSCoT, seed: int = 0) -> Guided:
    """Walk out to the left and back by pelvis keyframes half a second apart; keep what guidance did at each scale."""
    times = [0.5 * i for i in range(1, round(2 * _SECONDS))]
    # The way sets out straight ahead, as the person stands.
    wanted = torch.tensor([[0.5 - 0.5 * math.cos(2 * math.pi * t / _SECONDS), 0.9, 0.95 * t] for t in times])
    target = {"joint": "pelvis", "position": wanted.tolist()}
    objective, context = Objective((Term("joint_target", target, at=times),)), Context(Scene.empty(), DEFAULT_BODY)
    scales: list[Scale] = []
    tilts: list[Tensor] = []
    posteriors: list[Tensor] = []
    expected: list[Motion] = []

    def watched(scale: Scale, guide: Guide) -> Tensor:
        posterior = tilted(scale, guide)
        with torch.no_grad():
            expected.append(scale.step.decode(posterior.exp() @ scale.codes))
        scales.append(scale)
        tilts.append(scale.first_order(guide))
        posteriors.append(posterior)
        return posterior

    observed = MSCoT(generator.bundle, generator.sampling, watched)
    made = make(observed, _PROMPT, _SECONDS, Pose2D(), objective, context, seed=seed)
    return Guided(scales, tilts, posteriors, expected, made.motion, (times, wanted))


def draw_scales(guided: Guided, poses: Path, paths: Path) -> None:
    """The motion after each scale under guidance (Fig. 6): as poses, and as the pelvis's path seen from above."""
    times, wanted = guided.keyframes
    frames = [round(t * FPS) for t in times]
    stages = {f"scale {k + 1}": motion for k, motion in enumerate(guided.expected)} | {"refined": guided.finished}
    rows = []
    figure = _figure(1.55 * len(stages), 4.6)
    for axis, (name, motion) in zip(figure.subplots(1, len(stages), sharey=True), stages.items(), strict=True):
        joints = motion.joints[0].detach()
        pelvis = joints[:, 0]
        centimetres = 100 * float((pelvis[frames] - wanted).norm(dim=-1).mean())
        rows.append((f"{name}: {centimetres:.1f} cm from the keyframes", joints.numpy()))
        axis.plot(pelvis[:, 0].numpy(), pelvis[:, 2].numpy(), color=_BLUE, linewidth=1.6)
        axis.scatter(wanted[:, 0].numpy(), wanted[:, 2].numpy(), color=_RED, s=9, zorder=3)
        axis.set_title(f"{name}\n{centimetres:.1f} cm", fontsize=8)
        axis.set(aspect="equal", xlim=(1.7, -0.7), ylim=(-0.5, 0.95 * _SECONDS + 0.5))
        axis.tick_params(labelsize=7)
        axis.grid(alpha=0.25)
    figure.supxlabel("to the left (m), seen from above", fontsize=8)
    figure.supylabel("ahead (m)", fontsize=8)
    _save(figure, paths)
    draw_strips(rows, poses)


def draw_tilt(guided: Guided, png: Path) -> None:
    """The codebook in two dimensions, before and after guidance, and the weights by which it moved (Fig. 8).

    Shown where guidance moved the distribution most: at that position of that scale. Codes lie along the gradient
    (across) and along their own widest direction beside it (up).
    """
    moved = [
        float((post.exp() * (post - scale.prior)).sum(-1)[0].max())
        for scale, post in zip(guided.scales, guided.posteriors, strict=True)
    ]
    k = max(range(len(moved)), key=lambda i: moved[i])
    scale, post = guided.scales[k], guided.posteriors[k]
    at = int((post.exp() * (post - scale.prior)).sum(-1)[0].argmax())
    flat = _plane(scale.codes, guided.tilts[k][0, at])
    before, after = scale.prior[0, at].exp(), post[0, at].exp()
    weight = (post - scale.prior)[0, at]
    figure = _figure(10.0, 3.6)
    axes = figure.subplots(1, 3, sharex=True, sharey=True)
    for axis, p, title in ((axes[0], before, "before guidance"), (axes[1], after, "after guidance")):
        order = p.argsort()
        x, y, shown = flat[order, 0].numpy(), flat[order, 1].numpy(), p[order].numpy()
        dots = axis.scatter(x, y, c=shown, s=8 + 400 * shown, cmap="viridis", edgecolors="#55555555", linewidths=0.3)
        axis.set_title(f"{title}: {float(_entropy(p)):.2f} nats of entropy", fontsize=9)
        figure.colorbar(dots, ax=axis, label="probability", fraction=0.05)
    limit = max(float(weight.abs().max()), 1e-6)
    dots = axes[2].scatter(
        flat[:, 0].numpy(), flat[:, 1].numpy(), c=weight.numpy(), s=12, cmap="RdBu_r", vmin=-limit, vmax=limit
    )
    axes[2].set_title("what guidance added to log p", fontsize=9)
    figure.colorbar(dots, ax=axes[2], label="nats", fraction=0.05)
    for axis in axes:
        axis.set_xlabel("along the gradient", fontsize=8)
        axis.tick_params(labelsize=7)
    axes[0].set_ylabel("widest direction beside it", fontsize=8)
    figure.suptitle(f"{len(flat)} codes at scale {k + 1}, position {at + 1} of {scale.prior.shape[1]}", fontsize=9)
    _save(figure, png)


def _plane(codes: Float[Tensor, "V d"], scores: Float[Tensor, " V"]) -> Float[Tensor, "V 2"]:
    """Codes along the direction in which `scores` (linear in them) rise, and along their widest one beside it."""
    centred = codes - codes.mean(0)
    along = torch.linalg.lstsq(centred, (scores - scores.mean())[:, None]).solution[:, 0]
    along = along / along.norm().clamp_min(1e-12)
    beside = centred - (centred @ along)[:, None] * along
    widest = torch.linalg.svd(beside, full_matrices=False).Vh[0]
    return torch.stack([centred @ along, beside @ widest], dim=1)


def draw_trade_off(rows: Sequence[Mapping[str, Any]], png: Path) -> None:
    """Error, realism and seconds against the number of refinement iterations (Fig. 9)."""
    columns = {
        "average_error_m": "distance from the keyframes (m)",
        "max_acceleration_m_per_frame2": "max. acceleration (m/frame²)",
        "skating_ratio": "skating ratio",
        "seconds": "seconds",
    }
    figure = _figure(3.0 * len(columns), 2.8)
    x = [row["refinement_iterations"] for row in rows]
    for axis, (key, label) in zip(figure.subplots(1, len(columns)), columns.items(), strict=True):
        axis.plot(x, [row[key] for row in rows], color=_BLUE, marker="o", markersize=3)
        real = f"{key.replace('_m_per', '_real_m_per')}" if "acceleration" in key else f"{key}_real"
        if real in rows[0]:
            axis.axhline(rows[0][real], color=_GREY, linestyle="--", linewidth=1, label="real motions")
            axis.legend(fontsize=7)
        axis.set(xlabel="refinement iterations", ylabel=label)
        axis.set_ylim(bottom=0)
        axis.grid(alpha=0.3)
    _save(figure, png)


def _entropy(p: Float[Tensor, " V"]) -> Tensor:
    return -torch.special.xlogy(p, p).sum()


def _figure(width: float, height: float) -> Any:
    from matplotlib.figure import Figure  # without pyplot, so that no window system is asked for

    return Figure(figsize=(width, height), layout="constrained")


def _save(figure: Any, png: Path) -> None:
    png.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(png) as file:
        figure.savefig(file, format="png", dpi=120)
