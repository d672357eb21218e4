"""Small variants of a recipe, trained one after the other on the same data and set side by side."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.mscot.training.measures import beginnings, code_use, least_use
from scenectl.generators.mscot.training.tokenizer import reconstruction_error
from scenectl.training.command import Run
from scenectl.training.placement import Placement
from scenectl.training.recipe import Recipe, Variant, load_recipe
from scenes.errors import UserError
from scenes.files import atomic_write

Row = dict[str, Any]
Tell = Callable[[str, float], None]

LOOPS = ("tokenizer", "refiner", "transformer")


def train_sweep(
    data: str | Path,
    config: str | Path,
    out: str | Path,
    iterations: int,
    where: Placement | None = None,
    tell: Tell | None = None,
) -> list[Row]:
    """Train the tokenizers of a recipe's ``[[sweep]]`` variants; writes `sweep.md` and `sweep.json` in `out`.

    Raises:
        UserError: the recipe names no variants, a variant changes what recipes do not have, or see `Run`.
    """
    recipe = load_recipe(config)
    if not recipe.sweep:
        raise UserError(f"training config '{config}' has no [[sweep]] entries; add some, or take --config sweep")
    rows = sweep(recipe, recipe.sweep, Path(data), Path(out), iterations, where, tell)
    write_table(rows, Path(out) / "sweep", f"Variants of {recipe.model.name}, {iterations} iterations each")
    return rows


def sweep(
    recipe: Recipe,
    variants: Sequence[Variant],
    data: Path,
    out: Path,
    iterations: int,
    where: Placement | None = None,
    tell: Tell | None = None,
    measure: Callable[[Run, Tokenizer], Mapping[str, Any]] | None = None,
) -> list[Row]:
    """Train and measure the tokenizer of every variant; what is done is not done again.

    Args:
        recipe: what the variants are variants of.
        variants: trained in this order.
        data: folder of the motions.
        out: gets a folder for each variant, named after it and all of its settings.
        iterations: of each variant's tokenizer (and of whatever else `measure` trains).
        where: device and precision.
        tell: called with the variant's name and the share done.
        measure: more columns, from the variant's run and its finished tokenizer.
    """
    rows = []
    for i, variant in enumerate(variants):
        if tell is not None:
            tell(variant.name, i / len(variants))
        changed = shortened(recipe.varied(variant.set), iterations)
        run = Run(changed, data, out / f"{variant.name}-{_digest(changed)}", where=where, cache=out / "data")
        rows.append(_row(run, variant, measure))
    return rows


def shortened(recipe: Recipe, iterations: int) -> Recipe:
    """The recipe with every stage cut to so many iterations, and warm-ups to a tenth of them at most."""
    changes: dict[str, Any] = {}
    for part in LOOPS:
        warmup = min(getattr(recipe, part).loop.warmup, max(1, iterations // 10))
        changes |= {f"{part}.loop.iterations": iterations, f"{part}.loop.warmup": warmup}
    changes["decoder"] = None  # what is compared stops short of it
    changes["tokenizer.continuous"] = min(recipe.tokenizer.continuous, iterations // 4)
    return recipe.varied(changes)


def write_table(rows: Sequence[Row], path: Path, title: str) -> None:
    """Write rows as a Markdown table (`path`.md) and as JSON (`path`.json), each whole or not at all."""
    columns = list(dict.fromkeys(key for row in rows for key, value in row.items() if not isinstance(value, dict)))
    lines = [f"# {title}", "", f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]
    lines += [f"| {' | '.join(_cell(row.get(column)) for column in columns)} |" for row in rows]
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path.with_suffix(".md"), "w") as file:
        file.write("\n".join([*lines, ""]))
    with atomic_write(path.with_suffix(".json"), "w") as file:
        json.dump({"title": title, "rows": rows}, file, indent=1)


def _row(run: Run, variant: Variant, measure: Callable[[Run, Tokenizer], Mapping[str, Any]] | None) -> Row:
    """Train and measure one variant, or read what an earlier call found."""
    path = run.out / ("row.json" if measure is None else f"row-{measure.__name__.strip('_')}.json")
    if path.is_file():
        try:
            return dict(json.loads(path.read_text()))
        except ValueError as error:
            raise UserError(f"'{path}' is damaged ({error}); delete it and run again") from error
    loop = run.tokenizer()
    tokenizer = run.trained_tokenizer()
    speed = {"iterations_per_second": loop.iteration / max(loop.seconds, 1e-9)}
    row = {
        "variant": variant.name,
        "changes": variant.set,
        "iterations": loop.iteration,
        "parameters_m": sum(p.numel() for p in tokenizer.parameters()) / 1e6,
        **_reconstruction(run, tokenizer),
        **speed,
        "frames_per_second": loop.frames_per_second,
        **(measure(run, tokenizer) if measure is not None else {}),
    }
    with atomic_write(path, "w") as file:
        json.dump(row, file, indent=1)
    return row


def _reconstruction(run: Run, tokenizer: Tokenizer) -> dict[str, float]:
    """Errors and code use over the first 64 frames of the test clips."""
    test = run.windows(["test"], False)
    errors = reconstruction_error(tokenizer, test, 64)
    use = code_use(tokenizer, beginnings(test, 64))
    found = {f"error_{name}_m": errors[name]["global_error_m"] for name in ("bandai", "other", "all") if name in errors}
    return {
        **found,
        "local_error_m": errors["all"]["local_error_m"],
        "root_drift_m": errors["all"]["root_drift_m"],
        "codes_used": least_use(use),
        "perplexity": least_use(use, "perplexity"),
    }


def _digest(recipe: Recipe) -> str:
    """Eight letters that change with any setting, so that no variant goes on from another's state."""
    return hashlib.sha256(recipe.model_dump_json(exclude={"sweep"}).encode()).hexdigest()[:8]


def _cell(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else "" if value is None else str(value)
