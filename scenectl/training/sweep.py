"""Small variants of a recipe, trained one after the other on the same data and set side by side."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from scenectl.training.card import table
from scenectl.training.placement import place
from scenectl.training.recipe import Recipe, Variant, load_recipe
from scenectl.training.stages import Comparison, Run, Training
from scenes.errors import UserError
from scenes.files import atomic_write, write_json

Row = dict[str, Any]
Tell = Callable[[str, float], None]
R = TypeVar("R", bound=Recipe)

Measure = Callable[[Run[Any]], Mapping[str, Any]]
"""More columns of a variant's row, from its run."""


def train_sweep(
    data: str | Path,
    config: str | Path,
    out: str | Path,
    iterations: int,
    device: str = "auto",
    tell: Tell | None = None,
    *,
    plan: Training[Any],
) -> list[Row]:
    """Train what a recipe's ``[[sweep]]`` variants compare; writes `sweep.md` and `sweep.json` in `out`.

    Raises:
        UserError: the recipe names no variants, a variant changes what recipes do not have, or see `Run`.
    """
    recipe = load_recipe(config, plan.recipe)
    if not recipe.sweep:
        raise UserError(f"training config '{config}' has no [[sweep]] entries; add some, or take --config sweep")
    run = Run(plan, recipe, Path(data), Path(out), where=place(device, recipe.precision))
    rows = sweep(run, recipe.sweep, iterations, tell)
    write_table(rows, Path(out) / "sweep", f"Variants of {recipe.name}, {iterations} iterations each")
    return rows


def sweep(
    run: Run[Any],
    variants: Sequence[Variant],
    iterations: int,
    tell: Tell | None = None,
    measure: Measure | None = None,
) -> list[Row]:
    """Train and measure the compared stage of every variant; what is done is not done again.

    Args:
        run: of what the variants are variants of; its folder gets one for each, named after it and all its settings.
        variants: trained in this order.
        iterations: of each variant's compared stage (and of whatever else `measure` trains).
        tell: called with the variant's name and the share done.
        measure: more columns.

    Raises:
        UserError: the family compares nothing.
    """
    plan, recipe, out = run.plan, run.recipe, run.out
    if plan.comparison is None:
        raise UserError(f"generator '{recipe.family}' has no sweep; train its variants one by one")
    rows = []
    for i, variant in enumerate(variants):
        if tell is not None:
            tell(variant.name, i / len(variants))
        changed = shortened(plan, recipe.varied(variant.set), iterations)
        one = replace(run, recipe=changed, out=out / f"{variant.name}-{digest(changed)}", cache=out / "data")
        rows.append(_row(one, plan.comparison, variant, measure))
    return rows


def shortened(plan: Training[R], recipe: R, iterations: int) -> R:
    """The recipe with every stage cut to so many iterations, and warm-ups to a tenth of them at most."""
    changes: dict[str, Any] = {}
    for stage in plan.stages:
        settings = getattr(recipe, stage.name)
        if settings is not None:
            warmup = min(settings.loop.warmup, max(1, iterations // 10))
            changes |= {f"{stage.name}.loop.iterations": iterations, f"{stage.name}.loop.warmup": warmup}
    extra = {} if plan.comparison is None else plan.comparison.shortened(recipe, iterations)
    return recipe.varied({**changes, **extra})


def write_table(rows: Sequence[Row], path: Path, title: str) -> None:
    """Write rows as a Markdown table (`path`.md) and as JSON (`path`.json), each whole or not at all."""
    columns = list(dict.fromkeys(key for row in rows for key, value in row.items() if not isinstance(value, dict)))
    lines = [f"# {title}", "", *table(columns, ([_cell(row.get(column)) for column in columns] for row in rows))]
    with atomic_write(path.with_suffix(".md"), "w") as file:
        file.write("\n".join([*lines, ""]))
    write_json({"title": title, "rows": rows}, path.with_suffix(".json"))


def _row(run: Run[Any], comparison: Comparison, variant: Variant, measure: Measure | None) -> Row:
    """Train and measure one variant, or read what an earlier call found."""
    path = run.out / ("row.json" if measure is None else f"row-{measure.__name__.strip('_')}.json")
    if path.is_file():
        try:
            return dict(json.loads(path.read_text()))
        except ValueError as error:
            raise UserError(f"'{path}' is damaged ({error}); delete it and run again") from error
    run.train(comparison.stage)
    loop = run.finished(comparison.stage)
    row = {
        "variant": variant.name,
        "changes": variant.set,
        "iterations": loop.iteration,
        "parameters_m": sum(p.numel() for p in loop.averaged.parameters()) / 1e6,
        **comparison.columns(run),
        "iterations_per_second": loop.iteration / max(loop.seconds, 1e-9),
        "frames_per_second": loop.frames_per_second,
        **(measure(run) if measure is not None else {}),
    }
    write_json(row, path)
    return row


def digest(recipe: Recipe) -> str:
    """Eight letters that change with any setting, so that no variant goes on from another's state."""
    return hashlib.sha256(recipe.model_dump_json(exclude={"family", "sweep"}).encode()).hexdigest()[:8]


def _cell(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else "" if value is None else str(value)
