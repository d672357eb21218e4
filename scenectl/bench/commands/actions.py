"""`scenectl bench actions`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import criteria_shown, measured, shown
from scenectl.console.options import Generators, Json, Seed, Shard, Threads, Weights


def actions(
    scene: Annotated[
        list[str] | None,
        typer.Option("--scene", help="A file with named parts, or a bundled scene; repeatable, besides the bundled."),
    ] = None,
    bundled: Annotated[bool, typer.Option(help="Draw scripts in the bundled scenes, too.")] = True,
    scripts: Annotated[int, typer.Option(min=1, help="Scripts of two to five actions, in all scenes.")] = 150,
    samples: Annotated[int, typer.Option(min=1, help="Motions for each script; the best is scored.")] = 4,
    acts: Annotated[Path | None, typer.Option(help="Folder of the second classifier, instead of ours.")] = None,
    pictures: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Draw each script that fails, as `run` does, in DIR.")
    ] = None,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generators = None,
    threads: Threads = None,
    json_file: Json = None,
    shard: Shard = None,
) -> None:
    """Random scripts that can be planned: is each action done, believable, and in order?"""
    from scenectl.api import draw
    from scenectl.bench.control.actions import bench_actions
    from scenectl.evaluation import SHIPPED
    from scenectl.evaluation.kinds import ACTS, load_classifier
    from scenes.errors import UserError
    from scenes.files import writable_folder
    from scenes.world.scene import bundled_names

    scenes = [*(bundled_names() if bundled else ()), *(scene or ())]
    if not scenes:
        raise UserError("there is no scene to draw scripts in; name one with --scene")
    if pictures is not None:
        writable_folder(pictures)
    classifier = load_classifier(acts or SHIPPED, ACTS)
    drawn = None if pictures is None else (pictures, draw)
    result = measured(
        lambda maker, engine: bench_actions(maker, classifier, scenes, scripts, seed, samples, drawn, engine),
        weights, threads, generator, json_file, shard,
    )  # fmt: skip
    columns = ("script", "scene", "number", "kind", "done", "believable", "in_order", "success", "verdict")
    shown(result, json_file, columns)
    criteria_shown(result)
