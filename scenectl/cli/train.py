"""`scenectl train`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.console.console import out, say, show
from scenectl.console.options import DATA, Data
from scenectl.threads import sleep_while_waiting
from scenes.errors import UserError, did_you_mean


def train(
    stage: Annotated[
        str,
        typer.Argument(
            help="all, a stage of the recipe's family (MSCoT: tokenizer, decoder, refiner, transformer), export, "
            "metric, sweep, evaluator or acts (the second classifier)."
        ),
    ],
    data: Data = DATA,
    config: Annotated[str, typer.Option(help="compact, permissive, paper, or a recipe (TOML).")] = "compact",
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the run.")] = Path("runs/compact"),
    iterations: Annotated[int | None, typer.Option(min=1, help="Instead of the recipe's, for one stage.")] = None,
    text: Annotated[str | None, typer.Option(help="Text encoder instead of the recipe's.")] = None,
    threads: Annotated[int | None, typer.Option(min=1, max=256, help="CPU threads; torch's choice by default.")] = None,
    device: Annotated[str, typer.Option(help="auto, cpu or cuda.")] = "auto",
    weights: Annotated[
        str | None,
        typer.Option(help="Finished weights, which stand for stages not trained here."),
    ] = None,
    start: Annotated[
        str | None, typer.Option(help="Finished weights, at which training begins instead of at random ones.")
    ] = None,
) -> None:
    """Train one stage or all, compare small variants (sweep), or train what evaluates; what was stopped goes on."""
    sleep_while_waiting()
    from scenectl.generators.training import plan_of
    from scenectl.training.command import train as learn

    if stage == "sweep":
        _sweep(data, config, output, iterations, threads, device)
        return
    if stage in ("evaluator", "acts"):
        from scenectl.evaluation.training import train_acts, train_evaluator

        judged = {"evaluator": train_evaluator, "acts": train_acts}[stage](data, output)
        out.print(f"the weights are in {judged}")
        return
    plan = plan_of(config)
    known = ("all", *plan.commands, "sweep", "evaluator", "acts")
    if stage not in known:
        raise UserError(f"unknown stage '{stage}'{did_you_mean(stage, known)}")
    folder = learn(stage, data, config, output, iterations, text, threads, device, weights, start, plan=plan)
    out.print(f"the run is in {folder}")


def _sweep(data: Path, config: str, output: Path, iterations: int | None, threads: int | None, device: str) -> None:
    from scenectl.generators.training import plan_of
    from scenectl.threads import use
    from scenectl.training.sweep import train_sweep

    if threads is not None:
        use(threads)
    rows = train_sweep(data, config, output, iterations or 1000, device, say, plan=plan_of(config))
    show({"rows": rows, "summary": {"table": str(output / "sweep.md")}})
