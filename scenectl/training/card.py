"""The model card that goes with weights: data, terms, training, curves, figures."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from scenectl.data.features import FPS
from scenectl.generators.mscot.training.tokenizer import REVIVED
from scenectl.training.loop import Loop
from scenectl.training.recipe import Recipe
from scenes.files import atomic_write


def write_card(
    folder: Path,
    recipe: Recipe,
    loops: Mapping[str, Loop],
    frames: Mapping[str, Mapping[str, int]],
    hours: tuple[float, float],
    terms: tuple[str, list[str]],
    metrics: Mapping[str, Any],
) -> None:
    """Write `MODEL_CARD.md`, `metrics.json` and `curves.png` beside the weights.

    Args:
        folder: of the weights.
        recipe: that they were trained by.
        loops: of each part, finished.
        frames: of training data by source and by kind of motion.
        hours: of training data as recorded, and with augmented copies.
        terms: licence of the weights, and credits.
        metrics: what was measured.
    """
    _draw_curves(loops, folder / "curves.png")
    with atomic_write(folder / "metrics.json", "w") as file:
        json.dump({"hours_recorded": hours[0], "hours_with_augmentation": hours[1], **metrics}, file, indent=1)
    licence, credits = terms
    lines = [
        f"# Model card: {recipe.model.name}",
        "",
        f"**Licence of the weights:** {licence}",
        "",
        "## Data",
        "",
        f"{hours[0]:.2f} hours as recorded at 20 fps, {hours[1]:.2f} with augmented copies, which the tables count.",
        "",
        *(line for what, count in frames.items() for line in _hours_table(what, count)),
        "Credits and terms of the sources:",
        "",
        *(f"- {credit}" for credit in credits),
        "",
        "## Training",
        "",
        "| part | iterations | minutes | parameters | last loss | frames a second |",
        "|---|---|---|---|---|---|",
        *(_row(part, loop) for part, loop in loops.items()),
        "",
        *_restarts(loops["tokenizer"]),
        "![loss curves](curves.png)",
        "",
        "## Figures on the test split",
        "",
        *_reconstruction_table(metrics["reconstruction"]),
        "",
        f"By joint, 64 frames, {metrics['clips']} clips:",
        "",
        *_joint_table(metrics["error_by_joint"]),
        "",
        "By frequency: root mean square of joints relative to the pelvis, about their mean over the clip:",
        "",
        *_band_table(metrics["error_by_band"]),
        "",
        "Scale by scale, 64 frames (perplexity: of the codes used; cross-entropy: of the transformer, nats a token):",
        "",
        *_scale_table(metrics["code_use"], metrics["cross_entropy_by_scale"]),
        "",
    ]
    with atomic_write(folder / "MODEL_CARD.md", "w") as file:
        file.write("\n".join(lines))


def _hours_table(what: str, frames: Mapping[str, int]) -> list[str]:
    rows = [f"| {name} | {count / FPS / 3600:.2f} |" for name, count in sorted(frames.items())]
    return [f"| {what} | hours |", "|---|---|", *rows, ""]


def _row(part: str, loop: Loop) -> str:
    parameters = sum(p.numel() for p in loop.module.parameters()) / 1e6
    last = f"{loop.curve[-1]['loss']:.3f}" if loop.curve else "-"
    rate = f"{loop.frames_per_second:,.0f}" if loop.frames_per_second is not None else "-"
    return f"| {part} | {loop.iteration} | {loop.seconds / 60:.0f} | {parameters:.2f} M | {last} | {rate} |"


def _restarts(loop: Loop) -> list[str]:
    """How many codes restarted on data because nothing used them; the curve holds means a step."""
    points = [point for point in loop.curve if REVIVED in point]
    if not points:
        return []
    total = sum(point[REVIVED] for point in points) * loop.settings.log_every
    half = [point[REVIVED] for point in points if point["iteration"] > loop.iteration / 2]
    late = sum(half) * loop.settings.log_every
    return [f"Codes restarted because nothing used them: {total:.0f}, {late:.0f} of them in the second half.", ""]


def _joint_table(errors: Mapping[str, Mapping[str, float]]) -> list[str]:
    rows = ["| joint | global | local |", "|---|---|---|"]
    return rows + [
        f"| {name.replace('_', ' ')} | {row['global_error_m'] * 1000:.0f} mm | {row['local_error_m'] * 1000:.0f} mm |"
        for name, row in errors.items()
    ]


def _band_table(bands: Sequence[Mapping[str, float]]) -> list[str]:
    rows = ["| band | real | reconstructed | difference |", "|---|---|---|---|"]
    for row in bands:
        real, got, error = (1000 * row[f"{name}_rms_m"] for name in ("true", "reconstructed", "error"))
        rows.append(f"| {row['low_hz']:g} to {row['high_hz']:g} Hz | {real:.1f} mm | {got:.1f} mm | {error:.1f} mm |")
    return rows


def _scale_table(use: Mapping[str, Sequence[Mapping[str, float]]], entropy: Sequence[float]) -> list[str]:
    rows = [
        "| scale | codes used, training | perplexity | codes used, test | perplexity | cross-entropy |",
        "|---|---|---|---|---|---|",
    ]
    for k, (train, test) in enumerate(zip(use["train"], use["test"], strict=True)):
        figures = [f"{part['share_used']:.0%} | {part['perplexity']:.0f}" for part in (train, test)]
        rows.append(f"| {k + 1} | {' | '.join(figures)} | {f'{entropy[k]:.2f}' if entropy else '-'} |")
    return rows


def _reconstruction_table(by_length: Mapping[str, Mapping[str, Mapping[str, float]]]) -> list[str]:
    rows = ["| frames | clips | set | global joints | local joints | root at the end |", "|---|---|---|---|---|---|"]
    for frames, sets in by_length.items():
        for name, figures in sets.items():
            rows.append(
                f"| {frames} | {figures['clips']:.0f} | {name} | {figures['global_error_m'] * 1000:.0f} mm "
                f"| {figures['local_error_m'] * 1000:.0f} mm | {figures['root_drift_m'] * 1000:.0f} mm |"
            )
    return rows


def _draw_curves(loops: Mapping[str, Loop], path: Path) -> None:
    from matplotlib.figure import Figure  # without pyplot, so that no window system is asked for

    figure = Figure(figsize=(4 * len(loops), 3), layout="constrained")
    for axis, (part, loop) in zip(figure.subplots(1, len(loops), squeeze=False)[0], loops.items(), strict=True):
        axis.plot([p["iteration"] for p in loop.curve], [p["loss"] for p in loop.curve], linewidth=1)
        axis.set(title=part, xlabel="iteration", ylabel="loss")
        axis.grid(alpha=0.3)
    with atomic_write(path) as file:
        figure.savefig(file, format="png", dpi=100)
