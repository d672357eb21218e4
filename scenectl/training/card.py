"""The model card that goes with weights: data, terms, training, curves, figures."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from scenectl.training.loop import Loop
from scenectl.training.recipe import Recipe
from scenes.files import atomic_write


def write_card(
    folder: Path,
    recipe: Recipe,
    loops: Mapping[str, Loop],
    frames_by_source: Mapping[str, int],
    hours: float,
    terms: tuple[str, list[str]],
    metrics: Mapping[str, Any],
) -> None:
    """Write `MODEL_CARD.md`, `metrics.json` and `curves.png` beside the weights."""
    _draw_curves(loops, folder / "curves.png")
    with atomic_write(folder / "metrics.json", "w") as file:
        json.dump({"hours_with_augmentation": hours, **metrics}, file, indent=1)
    licence, credits = terms
    lines = [
        f"# Model card: {recipe.model.name}",
        "",
        f"**Licence of the weights:** {licence}",
        "",
        "## Data",
        "",
        f"{hours:.2f} hours at 20 fps, augmented copies included (mirror, bent paths, speed).",
        "",
        "| source | hours |",
        "|---|---|",
        *(f"| {source} | {frames / 20 / 3600:.2f} |" for source, frames in sorted(frames_by_source.items())),
        "",
        "Credits and terms of the sources:",
        "",
        *(f"- {credit}" for credit in credits),
        "",
        "## Training",
        "",
        "| part | iterations | minutes | parameters | last loss |",
        "|---|---|---|---|---|",
        *(_row(part, loop) for part, loop in loops.items()),
        "",
        "![loss curves](curves.png)",
        "",
        "## Figures on the test split",
        "",
        *_reconstruction_table(metrics["reconstruction"]),
        "",
        "Cross-entropy by scale, nats a token, 64 frames: "
        + ", ".join(f"{value:.2f}" for value in metrics["cross_entropy_by_scale"]),
        "",
    ]
    with atomic_write(folder / "MODEL_CARD.md", "w") as file:
        file.write("\n".join(lines))


def _row(part: str, loop: Loop) -> str:
    parameters = sum(p.numel() for p in loop.module.parameters()) / 1e6
    last = f"{loop.curve[-1]['loss']:.3f}" if loop.curve else "-"
    return f"| {part} | {loop.iteration} | {loop.seconds / 60:.0f} | {parameters:.2f} M | {last} |"


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
