"""`scenectl bench` and `scenectl train`: the commands that take hours rather than seconds."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from scenectl.cli.console import bars, err, literal, out
from scenes.errors import UserError, did_you_mean
from scenes.files import atomic_write

bench = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Measure: each prints a table, --json keeps it.")

Meshes = Annotated[list[Path] | None, typer.Option("--mesh", help="A scan; repeatable. Default: bundled scenes.")]
Data = Annotated[Path, typer.Option("--data", help="Folder of the motion collection.")]
Json = Annotated[Path | None, typer.Option("--json", help='Write {"summary": ..., "rows": [...]} to this file.')]
Weights = Annotated[str, typer.Option(help="Weights: 'default', 'permissive' or a folder.")]
Seed = Annotated[int, typer.Option(help="Of everything random.")]
Threads = Annotated[int | None, typer.Option(min=1, help="CPU threads; torch's choice by default.")]
DATA = Path("../shared/data/motions")
PROMPTS = Path("../shared/data/progmogen.json")


@bench.command()
def rooms(
    mesh: Meshes = None,
    tasks: Annotated[int, typer.Option(min=1, help="Walks in each room.")] = 50,
    samples: Annotated[int, typer.Option(min=1, help="Motions for each task; the best is scored.")] = 4,
    seed: Seed = 0,
    weights: Weights = "default",
    threads: Threads = None,
    json_file: Json = None,
) -> None:
    """Random walks through rooms: target reached, nothing touched."""
    from scenectl.bench.control.rooms import bench_rooms

    _run_and_show(
        lambda tell: bench_rooms(_generator(weights, threads), mesh or (), tasks, seed, samples, progress=tell),
        json_file,
        (
            "mesh", "task", "reached", "clean", "missed_m", "deepest_penetration_m", "deepest_floor_penetration_m",
            "skating_ratio", "seconds",
        ),
    )  # fmt: skip


@bench.command()
def keyframes(
    data: Data = DATA,
    clips: Annotated[int, typer.Option(min=1, help="Test clips.")] = 36,
    number: Annotated[int, typer.Option("--keyframes", min=1, help="Targets in each clip.")] = 5,
    seed: Seed = 0,
    weights: Weights = "default",
    threads: Threads = None,
    json_file: Json = None,
) -> None:
    """One joint at random keyframes of test motions, beside the same prompts without control."""
    from scenectl.bench.control.keyframes import bench_keyframes

    _run_and_show(
        lambda tell: bench_keyframes(_generator(weights, threads), data, clips, number, seed, progress=tell), json_file
    )


@bench.command("control")
def control_bench(
    data: Data = DATA,
    clips: Annotated[int, typer.Option(min=1, help="Test clips for each joint and density.")] = 2,
    method: Annotated[list[str] | None, typer.Option(help="A method; repeatable. Default: all six.")] = None,
    joint: Annotated[list[str] | None, typer.Option(help="A joint; repeatable. Default: six of them.")] = None,
    density: Annotated[list[str] | None, typer.Option(help="1, 2, 5, 25% or 100%; repeatable. Default: all.")] = None,
    scene: Annotated[
        list[str] | None, typer.Option(help="empty, or pillars close to the way; repeatable. Default: empty.")
    ] = None,
    shortest: Annotated[int, typer.Option(min=64, max=196, help="Frames that clips have at least.")] = 64,
    seed: Seed = 0,
    weights: Weights = "default",
    threads: Threads = None,
    json_file: Json = None,
    plot_file: Annotated[Path | None, typer.Option("--plot", help="Draw error against seconds to this file.")] = None,
) -> None:
    """Ways of reaching keyframes on the same motions: the paper's, ControlMM's, Adam, L-BFGS and ours."""
    from scenectl.bench.control.control import bench_control, plot
    from scenectl.bench.control.keyframes import DENSITIES, JOINTS
    from scenectl.bench.control.rivals import METHODS

    chosen = (method or METHODS, joint or JOINTS, density or tuple(DENSITIES), scene or ("empty",))
    with bars() as tell:
        result = bench_control(_generator(weights, threads), data, clips, *chosen, shortest, seed, tell)
    _show(
        result,
        json_file,
        (
            "method", "scene", "joint", "density", "frames", "seconds", "refine_seconds", "passes", "average_error_m",
            "deepest_penetration_m", "moved_m", "max_acceleration_m_per_frame2", "skating_ratio",
        ),
    )  # fmt: skip
    if plot_file is not None:
        plot(result, plot_file)
        out.print(f"wrote {plot_file}")


@bench.command()
def implausible(
    data: Data = DATA,
    clips: Annotated[int, typer.Option(min=1, help="Test clips for each kind of bad target.")] = 8,
    seed: Seed = 0,
    weights: Weights = "default",
    threads: Threads = None,
    json_file: Json = None,
) -> None:
    """Targets out of reach, or noise: bones, feet, and whether the culprit is named, beside goals alone."""
    from scenectl.bench.control.implausible import bench_implausible

    with bars() as tell:
        result = bench_implausible(_generator(weights, threads), data, clips, seed, tell)
    _show(
        result,
        json_file,
        (
            "kind", "way", "frames", "ended", "bone_error_m", "bone_error_free_m", "lift_m", "named", "seconds",
            "diagnosis",
        ),
    )  # fmt: skip


@bench.command()
def progmogen(
    prompts: Annotated[Path, typer.Option("--data", help="ProgMoGen's prompts (JSON).")] = PROMPTS,
    task: Annotated[list[str] | None, typer.Option(help="hsi1, hsi2, hsi3; repeat for more. Default: all.")] = None,
    count: Annotated[int | None, typer.Option(min=1, help="Prompts of each task.")] = None,
    seed: Seed = 0,
    weights: Weights = "default",
    threads: Threads = None,
    json_file: Json = None,
) -> None:
    """ProgMoGen's HSI-1, HSI-2 and HSI-3, beside the same prompts without control."""
    from scenectl.bench.control.progmogen import COLUMNS, TASKS, bench_progmogen, table

    chosen = task or list(TASKS)
    for name in chosen:
        if name not in TASKS:
            raise UserError(f"unknown task '{name}'{did_you_mean(name, TASKS)}")
    counts = None if count is None else dict.fromkeys(chosen, count)
    with bars() as tell:
        result = bench_progmogen(_generator(weights, threads), prompts, chosen, counts, seed=seed, progress=tell)
    lines = Table("task", "method", "prompts", *(heading for _, heading in COLUMNS), box=None, pad_edge=False)
    for line in table(result):
        lines.add_row(*line)
    out.print(lines)
    _keep(result, json_file)


@bench.command()
def tokenizer(data: Data = DATA, weights: Weights = "default", json_file: Json = None) -> None:
    """Reconstruction of test motions by the tokenizer."""
    from scenectl.bench.models.tokenizer import bench_tokenizer

    _run_and_show(lambda tell: bench_tokenizer(weights, data), json_file)


@bench.command("bake")
def bake_bench(
    mesh: Annotated[list[str] | None, typer.Option(help="A known mesh or a file; repeatable. Default: all.")] = None,
    tool: Annotated[list[str] | None, typer.Option(help="A tool; repeatable. Default: all installed.")] = None,
    resolution: Annotated[int, typer.Option(help="Nodes along each axis.")] = 256,
    runs: Annotated[int, typer.Option(min=1, help="Of each tool on each mesh, in turn; medians count.")] = 3,
    timeout: Annotated[float, typer.Option(min=0.01, help="Seconds after which a bake is given up.")] = 900.0,
    json_file: Json = None,
    plot_file: Annotated[Path | None, typer.Option("--plot", help="Draw CPU-seconds to this PNG file.")] = None,
) -> None:
    """Bakes beside those of other tools (extra 'peers'): CPU-seconds, memory, errors, contradictions."""
    from scenectl.bench.scenes.bake import bench_bake, plot

    result = bench_bake(
        mesh or (), tool or (), resolution, runs, timeout,
        progress=lambda what, done: err.print(literal(f"{done:4.0%} {what}")),
        keep=None if json_file is None else lambda found: _write(found, json_file),
    )  # fmt: skip
    _show(
        result,
        json_file,
        (
            "mesh", "tool", "cpu_s", "wall_s", "peak_mb", "near_error_voxels", "impossible_flips", "far_error_voxels",
            "sign_errors", "base_mb", "triangles", "runs", "note",
        ),
    )  # fmt: skip
    if plot_file is not None:
        plot(result, plot_file)
        out.print(f"wrote {plot_file}")


@bench.command()
def edit(
    mesh: Annotated[
        Path | None, typer.Option(help="A file of named objects. Default: the bundled living room.")
    ] = None,
    resolution: Annotated[int, typer.Option(help="Nodes along the longest side.")] = 256,
    rounds: Annotated[int, typer.Option(min=1, help="Moves, removals and additions, as many of each.")] = 5,
    seed: Seed = 0,
    json_file: Json = None,
) -> None:
    """Objects of a scene moved, removed and added, against baking it anew: seconds, every bit equal."""
    from scenectl.bench.scenes.edit import bench_edit

    _run_and_show(lambda tell: bench_edit(mesh, resolution, rounds, seed, tell), json_file)


@bench.command("query")
def query_bench(
    scene: Annotated[str, typer.Option(help="The bundled scene whose grid is asked.")] = "living_room",
    resolution: Annotated[int, typer.Option(help="Nodes along every side.")] = 256,
    pattern: Annotated[list[str] | None, typer.Option(help="body or uniform; repeatable. Default: body.")] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Turns of each method; the median counts.")] = 15,
    processes: Annotated[int, typer.Option(min=1, help="Fresh processes that measure, one after the other.")] = 1,
    seed: Seed = 0,
    json_file: Json = None,
    plot_file: Annotated[Path | None, typer.Option("--plot", help="Draw the rows to this PNG, PDF or SVG.")] = None,
) -> None:
    """Value and gradient at many points, one thread, beside torch's grid_sample and others."""
    from scenectl.bench.scenes.query import COUNTS, bench_query, plot

    def work(tell: Any) -> Any:
        patterns = tuple(pattern or ("body",))
        result = bench_query(scene, resolution, repeats, seed, COUNTS, patterns, processes, tell)
        if plot_file is not None:
            plot(result, plot_file)
        return result

    _run_and_show(work, json_file)


@bench.command()
def building(
    spacing: Annotated[float, typer.Option(help="Metres between the finest nodes.")] = 0.02,
    width: Annotated[float, typer.Option(min=10.0, help="Of the building, metres.")] = 50.0,
    seed: Seed = 0,
    json_file: Json = None,
) -> None:
    """A furnished building of five storeys as a sparse grid: memory, time, errors against the oracle, queries."""
    from scenectl.bench.scenes.building import bench_building

    _run_and_show(lambda tell: bench_building(spacing, width, seed, tell), json_file)


@bench.command()
def posterior(
    generations: Annotated[int, typer.Option(min=1, help="Motions that are looked at.")] = 8,
    seed: Seed = 0,
    weights: Weights = "default",
    threads: Threads = None,
    json_file: Json = None,
) -> None:
    """The first-order token posterior against the exact one, scale by scale (Tables 12 and 13)."""
    from scenectl.bench.models.posterior import bench_posterior

    _run_and_show(
        lambda tell: bench_posterior(_generator(weights, threads), generations, seed=seed, progress=tell), json_file
    )


@bench.command("generator")
def generator_bench(
    data: Data = DATA,
    clips: Annotated[int | None, typer.Option(min=1, help="Test clips. Default: all.")] = None,
    evaluator: Annotated[str, typer.Option(help="own, or guo with --evaluator-folder.")] = "own",
    evaluator_folder: Annotated[Path | None, typer.Option(help="Where the evaluator's weights lie.")] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Of everything random; intervals come from them.")] = 20,
    seed: Seed = 0,
    weights: Weights = "default",
    threads: Threads = None,
    json_file: Json = None,
    plot_file: Annotated[Path | None, typer.Option("--plot", help="Draw the confusion of kinds to this file.")] = None,
    page: Annotated[Path | None, typer.Option(help="Write all of it as a page (Markdown) to this file.")] = None,
) -> None:
    """All of the evaluation: errors, standard metrics, plausibility, kinds, beside real motions and baselines."""
    from scenectl.bench.models.generator import bench_generator, plot
    from scenectl.bench.models.page import evaluation_page
    from scenectl.evaluation.evaluator import load_evaluator
    from scenectl.evaluation.kinds import load_classifier

    judge = load_evaluator(evaluator, evaluator_folder)
    classifier = load_classifier()
    with bars() as tell:
        result = bench_generator(
            _generator(weights, threads), judge, classifier, data, clips, repeats, seed, tell
        )  # fmt: skip
    out.print(
        literal(f"evaluator: {result['evaluator']}; {result['clips']} test clips; never beside published figures")
    )
    _show(result, json_file)
    recall = result["kinds"]["generated"]["recall"]
    out.print(literal("recall by kind: " + ", ".join(f"{kind} {_cell(share)}" for kind, share in recall.items())))
    if plot_file is not None:
        plot(result, plot_file)
        out.print(f"wrote {plot_file}")
    if page is not None:
        with atomic_write(page, "w") as file:
            file.write(evaluation_page(result, weights, plot_file))
        out.print(f"wrote {page}")


@bench.command()
def ablations(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of tables, figures and small models.")],
    data: Data = DATA,
    only: Annotated[list[str] | None, typer.Option(help="One ablation; repeat for more. Default: all.")] = None,
    iterations: Annotated[int, typer.Option(min=10, help="Of every small model that is trained.")] = 1000,
    clips: Annotated[int, typer.Option(min=1, help="Test clips where joints are controlled.")] = 12,
    config: Annotated[str, typer.Option(help="The recipe whose variants are trained.")] = "compact",
    weights: Weights = "default",
    threads: Threads = None,
    device: Annotated[str, typer.Option(help="auto, cpu or cuda, for training.")] = "auto",
) -> None:
    """The paper's ablations and figures on our data: each writes its table, what was stopped goes on."""
    from scenectl.bench.studies.ablations import ABLATIONS, Bench, bench_ablations

    for name in only or ():
        if name not in ABLATIONS:
            raise UserError(f"unknown ablation '{name}'{did_you_mean(name, ABLATIONS)}")
    setting = Bench(data, output, config, weights, iterations, clips, device, threads)
    for path in bench_ablations(setting, only or tuple(ABLATIONS), _say):
        out.print(f"wrote {path}")


@bench.command()
def gallery(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the page and its pictures.")],
    samples: Annotated[int, typer.Option(min=1, help="Motions of each prompt.")] = 3,
    data: Annotated[
        Path | None, typer.Option("--data", help="Motion collection: also draw what pose edits make of a walk.")
    ] = None,
    seed: Seed = 0,
    weights: Weights = "default",
    threads: Threads = None,
) -> None:
    """A page of twelve prompts with three samples each, good and bad: nothing is picked."""
    from scenectl.bench.models.gallery import draw_edits, draw_gallery

    with bars() as tell:
        page = draw_gallery(_generator(weights, threads), output, samples, seed, tell)
    if data is not None:
        draw_edits(data, output / "edits.png", seed)
    out.print(f"wrote {page}")


def train(
    stage: Annotated[
        str, typer.Argument(help="all, tokenizer, decoder, refiner, transformer, export, metric, sweep or evaluator.")
    ],
    data: Data = DATA,
    config: Annotated[str, typer.Option(help="compact, permissive, paper, or a recipe (TOML).")] = "compact",
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the run.")] = Path("runs/compact"),
    iterations: Annotated[int | None, typer.Option(min=1, help="Instead of the recipe's, for one stage.")] = None,
    text: Annotated[str | None, typer.Option(help="Text encoder instead of the recipe's.")] = None,
    threads: Threads = None,
    device: Annotated[str, typer.Option(help="auto, cpu or cuda.")] = "auto",
) -> None:
    """Train one stage or all, compare small variants (sweep), or train what evaluates; what was stopped goes on."""
    from scenectl.training.command import STAGES
    from scenectl.training.command import train as learn

    known = ("all", *STAGES, "metric")
    if stage == "sweep":
        _sweep(data, config, output, iterations, threads, device)
        return
    if stage == "evaluator":
        from scenectl.evaluation.training import train_evaluator

        out.print(f"the weights are in {train_evaluator(data, output)}")
        return
    if stage not in known:
        raise UserError(f"unknown stage '{stage}'{did_you_mean(stage, (*known, 'sweep', 'evaluator'))}")
    folder = learn(stage, data, config, output, iterations, text, threads, device)
    out.print(f"the run is in {folder}")


def _sweep(data: Path, config: str, output: Path, iterations: int | None, threads: int | None, device: str) -> None:
    import torch

    from scenectl.generators.mscot.training.sweep import train_sweep
    from scenectl.training.placement import place
    from scenectl.training.recipe import load_recipe

    if threads is not None:
        torch.set_num_threads(threads)
    where = place(device, load_recipe(config).precision)
    rows = train_sweep(data, config, output, iterations or 1000, where, _say)
    _show({"rows": rows, "summary": {"table": str(output / "sweep.md")}}, None)


def _say(what: str, done: float) -> None:
    """A line for each thing that is done, where what is done draws a bar of its own."""
    err.print(literal(f"{done:4.0%} {what}"))


def _generator(weights: str, threads: int | None) -> Any:
    from scenectl.generators import load_generator

    generator = load_generator("mscot", weights, threads)
    err.print(literal(f"weights '{weights}': {generator.licence}"))
    return generator


def _run_and_show(work: Any, json_file: Path | None, columns: Sequence[str] = ()) -> None:
    """Run a bench, print its rows and its summary, and keep both."""
    with bars() as tell:
        result = work(tell)
    _show(result, json_file, columns)


def _show(result: Mapping[str, Any], json_file: Path | None, columns: Sequence[str] = ()) -> None:
    """Print rows and summary, and keep both."""
    rows = result["rows"]
    if rows:
        shown = [key for key in (columns or rows[0]) if _scalar(rows[0].get(key))]
        lines = Table(*shown, box=None, pad_edge=False)
        for row in rows:
            lines.add_row(*(_cell(row.get(key)) for key in shown))
        out.print(lines)
    out.print()
    _print_summary(result["summary"], "")
    _keep(result, json_file)


def _print_summary(summary: Mapping[str, Any], indent: str) -> None:
    for key, value in summary.items():
        if isinstance(value, Mapping):
            out.print(f"{indent}{key}:")
            _print_summary(value, indent + "  ")
        else:
            out.print(literal(f"{indent}{key}: {_cell(value)}"))


def _keep(result: Mapping[str, Any], json_file: Path | None) -> None:
    if json_file is not None:
        _write(result, json_file)
        out.print(f"wrote {json_file}")


def _write(result: Mapping[str, Any], json_file: Path) -> None:
    with atomic_write(json_file, "w") as file:
        json.dump(result, file, indent=1)


def _scalar(value: Any) -> bool:
    return value is None or isinstance(value, bool | int | float | str)


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else "" if value is None else str(value)
