"""`scenectl bench ablations`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.console.console import out, say
from scenectl.console.options import DATA, GENERATOR, Data, Generator, Threads, Weights
from scenes.errors import UserError, did_you_mean


def ablations(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of tables, figures and small models.")],
    data: Data = DATA,
    only: Annotated[list[str] | None, typer.Option(help="One ablation; repeat for more. Default: all.")] = None,
    iterations: Annotated[int, typer.Option(min=10, help="Of every small model that is trained.")] = 1000,
    clips: Annotated[int, typer.Option(min=1, help="Test clips where joints are controlled.")] = 12,
    config: Annotated[str, typer.Option(help="The recipe whose variants are trained.")] = "compact",
    weights: Weights = "default",
    generator: Generator = GENERATOR,
    acts: Annotated[Path | None, typer.Option(help="Folder of the second classifier, instead of ours.")] = None,
    threads: Threads = None,
    device: Annotated[str, typer.Option(help="auto, cpu or cuda, for training.")] = "auto",
) -> None:
    """The paper's ablations and figures on our data: each writes its table, what was stopped goes on."""
    from scenectl.bench.studies.ablations import ABLATIONS, Bench, bench_ablations

    for name in only or ():
        if name not in ABLATIONS:
            raise UserError(f"unknown ablation '{name}'{did_you_mean(name, ABLATIONS)}")
    setting = Bench(data, output, config, weights, iterations, clips, device, threads, generator, acts)
    for path in bench_ablations(setting, only or tuple(ABLATIONS), say):
        out.print(f"wrote {path}")
