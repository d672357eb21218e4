"""`scenectl bench generator`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scenectl.bench.commands.shared import criteria_shown, loaded, measured, shown, wrote
from scenectl.console.console import cell, out
from scenectl.console.options import DATA, GENERATOR, Data, Generators, Json, Seed, Threads, Weights
from scenes.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any


def generator(
    data: Data = DATA,
    clips: Annotated[int | None, typer.Option(min=1, help="Test clips. Default: all.")] = None,
    evaluator: Annotated[str, typer.Option(help="own, or guo with --evaluator-folder.")] = "own",
    evaluator_folder: Annotated[Path | None, typer.Option(help="Where the evaluator's weights lie.")] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Of everything random; intervals come from them.")] = 20,
    seed: Seed = 0,
    seeds: Annotated[int, typer.Option(min=1, help="Motions of each clip; figures are means over them.")] = 1,
    against: Annotated[str | None, typer.Option(help="Other weights, measured in the same run.")] = None,
    acts: Annotated[Path | None, typer.Option(help="Folder of the second classifier, instead of ours.")] = None,
    weights: Weights = "default",
    generator: Generators = None,
    threads: Threads = None,
    json_file: Json = None,
    plot_file: Annotated[Path | None, typer.Option("--plot", help="Draw the confusion of kinds to this file.")] = None,
    page: Annotated[Path | None, typer.Option(help="Write all of it as a page (Markdown) to this file.")] = None,
) -> None:
    """All of the evaluation: errors, standard metrics, plausibility, kinds, beside real motions and baselines."""
    from scenectl.bench.models.generator import bench_generator, plot
    from scenectl.evaluation import SHIPPED
    from scenectl.evaluation.evaluator import load_evaluator
    from scenectl.evaluation.kinds import ACTS, load_classifier

    if len(generator or ()) > 1 and (plot_file or page):
        raise UserError("--plot and --page show one generator; name one, or leave them out")
    if len(generator or ()) > 1 and against:
        raise UserError("--against compares weights of one generator; name one, or leave it out")
    judge, classifier = load_evaluator(evaluator, evaluator_folder), load_classifier()
    second = load_classifier(acts or SHIPPED, ACTS)
    other = loaded((generator or [GENERATOR])[0], against) if against else None
    result = measured(
        lambda maker, engine: bench_generator(
            maker, judge, classifier, data, clips, repeats, seed, engine, seeds, second, other
        ),
        weights, threads, generator, json_file,
    )  # fmt: skip
    _show(result, json_file)
    if plot_file is not None:
        plot(result, plot_file)
        wrote(plot_file)
    if page is not None:
        _write_page(result, weights, plot_file, page)


def _show(result: Mapping[str, Any], json_file: Path | None) -> None:
    evaluator, clips, several = result["evaluator"], result["clips"], {"": result["kinds"]}
    if isinstance(evaluator, dict):  # by generator
        (evaluator, *_), (clips, *_), several = evaluator.values(), clips.values(), result["kinds"]
    out.print(f"evaluator: {evaluator}; {clips} test clips; never beside published figures")
    shown(result, json_file)
    for name, kinds in several.items():
        recall = kinds["generated"]["recall"]
        shares = ", ".join(f"{kind} {cell(share)}" for kind, share in recall.items())
        out.print(f"recall by kind{name and f' of {name}'}: {shares}")
    criteria_shown(result)


def _write_page(result: Mapping[str, Any], weights: str, plot_file: Path | None, page: Path) -> None:
    from scenectl.bench.models.page import evaluation_page
    from scenes.files import atomic_write

    with atomic_write(page, "w") as file:
        file.write(evaluation_page(result, weights, plot_file))
    wrote(page)
