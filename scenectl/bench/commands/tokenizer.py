"""`scenectl bench tokenizer`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from scenectl.bench.commands.shared import measured, shown
from scenectl.console.console import out, table
from scenectl.console.options import DATA, Data, Generators, Json, Threads, Weights

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from scenectl.bench.engine import Engine, Result

_ERRORS = {
    "global_error_bandai_m": "Bandai, mm",
    "local_error_bandai_m": "local",
    "global_error_other_m": "other, mm",
    "local_error_other_m": "local",
}
_FIGURES = {
    "acceleration_over_real": "mean acc.",
    "max_acceleration_over_real": "max acc.",
    "power_over_real": "> 6 Hz",
    "recall": "recall",
    "recall_of_waves": "of waves",
}


def tokenizer(
    data: Data = DATA,
    weights: Weights = "default",
    generator: Generators = None,
    threads: Threads = None,
    json_file: Json = None,
) -> None:
    """Reconstruction of test motions by the tokenizer, and where it loses movement: by band, through each part."""
    from scenectl.bench.models.lost import bench_lost
    from scenectl.bench.models.tokenizer import bench_tokenizer
    from scenectl.evaluation.kinds import load_classifier

    classifier = load_classifier()

    def bench(maker: Any, engine: Engine) -> Result:
        return {**bench_tokenizer(maker, data, engine=engine), "lost": bench_lost(maker, classifier, data, engine)}

    result = measured(bench, weights, threads, generator, json_file)
    shown(result, json_file)
    lost = result["lost"]
    for name, rows in lost.items() if isinstance(lost, dict) else [("", lost)]:
        _show(name, rows)


def _show(name: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Where movement is lost: errors, and shares of what real motions do."""
    out.print(f"\nwhere movement is lost{name and f' by {name}'}: errors, the rest but recall over real motions")
    bands = list(rows[0]["kept"])
    lines = table("through", *_ERRORS.values(), *bands, *_FIGURES.values())
    for row in rows:
        errors = (None if row[key] is None else 1000 * row[key] for key in _ERRORS)
        shares = (*row["kept"].values(), *(row[key] for key in _FIGURES))
        lines.add_row(
            row["through"], *(_rounded(error, 0) for error in errors), *(_rounded(share, 2) for share in shares)
        )
    out.print(lines)


def _rounded(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"
