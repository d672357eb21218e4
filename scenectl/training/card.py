"""The model card that goes with weights: data, terms, training, curves, figures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from scenectl.data.clips import ClipSet, census
from scenectl.data.features import FPS
from scenectl.training.loop import Loop
from scenes.files import atomic_write, write_json

_WRITTEN = ("## Data", "## Training", "## Figures on the test split")
_COLUMNS = ("part", "iterations", "minutes", "parameters", "last loss", "frames a second")


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table."""
    return [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|", *(f"| {' | '.join(row)} |" for row in rows)]


def write_card(
    folder: Path,
    name: str,
    data: ClipSet,
    loops: Mapping[str, Loop],
    remarks: Sequence[str],
    figures: Mapping[str, Any],
    tables: Sequence[str],
) -> None:
    """Write `MODEL_CARD.md`, `metrics.json` and `curves.png` beside the weights.

    Sections that somebody has added to an earlier card, under titles of their own, stay.

    Args:
        folder: of the weights.
        name: of the networks.
        data: that they were trained on, with its augmented copies.
        loops: of each stage, finished.
        remarks: lines about the training.
        figures: what was measured on the test split.
        tables: lines that show them.
    """
    _draw_curves(loops, folder / "curves.png")
    hours = {"hours_recorded": data.recorded_hours, "hours_with_augmentation": data.hours}
    write_json({**hours, **figures}, folder / "metrics.json")
    licence, credits = data.terms()
    frames = {"source": census(data, data.sources), "kind": census(data, data.groups)}
    lines = [
        f"# Model card: {name}",
        "",
        f"**Licence of the weights:** {licence}",
        "",
        _WRITTEN[0],
        "",
        f"{data.recorded_hours:.2f} hours as recorded at 20 fps, {data.hours:.2f} with augmented copies, which the "
        "tables count.",
        "",
        *(line for what, count in frames.items() for line in (*_hours_table(what, count), "")),
        "Credits and terms of the sources:",
        "",
        *(f"- {credit}" for credit in credits),
        "",
        _WRITTEN[1],
        "",
        *table(_COLUMNS, (_row(part, loop) for part, loop in loops.items())),
        "",
        *remarks,
        "![loss curves](curves.png)",
        "",
        *_added(folder / "MODEL_CARD.md"),
        _WRITTEN[2],
        "",
        *tables,
        "",
    ]
    with atomic_write(folder / "MODEL_CARD.md", "w") as file:
        file.write("\n".join(lines))


def _added(card: Path) -> list[str]:
    """Lines of a card's sections that are not written here."""
    if not card.is_file():
        return []
    lines, kept = list[str](), False
    for line in card.read_text(encoding="utf-8").splitlines():
        kept = line not in _WRITTEN if line.startswith("## ") else kept
        lines += [line] if kept else []
    return lines


def _hours_table(what: str, frames: Mapping[str, int]) -> list[str]:
    return table((what, "hours"), ((name, f"{count / FPS / 3600:.2f}") for name, count in sorted(frames.items())))


def _row(part: str, loop: Loop) -> tuple[str, ...]:
    parameters = sum(p.numel() for p in loop.module.parameters()) / 1e6
    if not loop.iteration:
        return part, "taken over", "-", f"{parameters:.2f} M", "-", "-"
    last = f"{loop.curve[-1]['loss']:.3f}" if loop.curve else "-"
    rate = f"{loop.frames_per_second:,.0f}" if loop.frames_per_second is not None else "-"
    return part, f"{loop.iteration}", f"{loop.seconds / 60:.0f}", f"{parameters:.2f} M", last, rate


def _draw_curves(loops: Mapping[str, Loop], path: Path) -> None:
    from matplotlib.figure import Figure  # without pyplot, so that no window system is asked for

    loops = {part: loop for part, loop in loops.items() if loop.curve} or loops
    figure = Figure(figsize=(4 * len(loops), 3), layout="constrained")
    for axis, (part, loop) in zip(figure.subplots(1, len(loops), squeeze=False)[0], loops.items(), strict=True):
        axis.plot([p["iteration"] for p in loop.curve], [p["loss"] for p in loop.curve], linewidth=1)
        axis.set(title=part, xlabel="iteration", ylabel="loss")
        axis.grid(alpha=0.3)
    with atomic_write(path) as file:
        figure.savefig(file, format="png", dpi=100)
