"""The command line: every subcommand is a thin layer over a function that Python users call too.

Bad input is answered with one sentence on standard error and exit status 2, never with a traceback.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

import scenectl
from scenectl.cli.bench import bench, train
from scenectl.cli.console import bars, err, literal, out
from scenectl.cli.edit import edit
from scenes.errors import UserError, did_you_mean

if TYPE_CHECKING:
    from scenectl.pipeline.run import Result
    from scenes.body.body import ProxyBody
    from scenes.body.proxies import Proxies
    from scenes.body.rig import Rig
    from scenes.world.scene import Scene

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="A room, a sentence and goals in; a human motion that meets them out.",
)
app.add_typer(bench, name="bench")
app.command(name="train")(train)
app.command(name="edit")(edit)

TaskFile = Annotated[Path, typer.Argument(metavar="TASK", help="A task file (TOML).")]
AllowCode = Annotated[
    Path | None, typer.Option("--allow-code", metavar="FILE.py", help="Run this file for its @goal functions.")
]


@app.callback(invoke_without_command=True)
def _root(version: Annotated[bool, typer.Option("--version", help="Print the version and leave.")] = False) -> None:
    if version:
        out.print(scenectl.__version__)
        raise typer.Exit


@app.command()
def bake(
    scene: Annotated[str, typer.Argument(help="A mesh file (GLB, OBJ, PLY, STL, OFF, ...) or a bundled scene.")],
    unit: Annotated[str | None, typer.Option(help="Unit of the file: m, cm, mm, in, ft.")] = None,
    up: Annotated[str | None, typer.Option(help="Axis that points up in the file: x, y, z.")] = None,
    resolution: Annotated[int, typer.Option(help="Nodes along the longest side.")] = 256,
    free_space: Annotated[str, typer.Option(help="auto, outside, or x,y,z of a point in the air.")] = "auto",
    spacing: Annotated[float | None, typer.Option(help="Metres between nodes instead, for large scenes.")] = None,
    thickness: Annotated[float, typer.Option(help="Metres that walls without thickness are given.")] = 0.0,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the grid to this .npz file.")] = None,
    png: Annotated[Path | None, typer.Option(help="Draw the scene with a slice of its distances.")] = None,
) -> None:
    """Bake a scene's signed distances and say what was decided."""
    from scenes.sdf.grid import SdfGrid

    begin = time.perf_counter()
    found = _scene(scene, unit, up, resolution, free_space, thickness, spacing)
    with err.status("baking"):
        grids = [result.grid for result in found.bakes]
    for line in found.report():
        out.print(line)
    for grid in grids:
        size = " x ".join(str(n) for n in grid.shape)
        kept = "" if isinstance(grid, SdfGrid) else ", kept near surfaces only"
        out.print(f"grid: {size} nodes, spacing {1000 * grid.spacing:.1f} mm{kept}, {grid.nbytes / 1e6:.1f} MB")
    where = "found in the mesh" if found.floor.found else "stated"
    out.print(f"floor: {found.floor.height:.3f} m ({where}); done in {time.perf_counter() - begin:.1f} s")
    if output is not None:
        if len(grids) != 1:
            raise UserError(f"scene '{scene}' has {len(grids)} meshes; -o writes the grid of scenes with one")
        grids[0].save(output)
        out.print(f"wrote {output}")
    if png is not None:
        from scenectl.view import draw_scene

        draw_scene(found, png, show_slice=True)
        out.print(f"wrote {png}")


@app.command()
def scenes() -> None:
    """List the bundled scenes with their starts and targets."""
    import tomllib

    from scenes.world.scene import BUNDLED, bundled_names

    for name in bundled_names():
        facts = tomllib.loads((BUNDLED / f"{name}.toml").read_text(encoding="utf-8"))
        out.print(f"[bold]{name}[/bold]: {facts.get('notes', '')}")
        places = {"start": facts.get("start", {}).get("position"), **facts.get("targets", {}), **facts.get("reach", {})}
        out.print("   " + "  ".join(f"{key} {value}".replace("[", "\\[") for key, value in places.items() if value))


@app.command()
def goals(
    name: Annotated[str | None, typer.Argument(help="Show everything about one goal.")] = None,
    allow_code: AllowCode = None,
) -> None:
    """List the goals that a task can use."""
    from objectives import get_goal
    from objectives import goals as registered

    _allow(allow_code)
    if name is None:
        table = Table("goal", "unit", "meaning", box=None, pad_edge=False)
        for spec in registered():
            table.add_row(spec.name, spec.unit, spec.summary)
        out.print(table)
        out.print("\nscenectl goals NAME shows its parameters.")
        return
    spec = get_goal(name)
    out.print(f"[bold]{spec.name}[/bold] ({spec.unit}): {spec.summary}")
    table = Table("parameter", "type", "default", "meaning", box=None, pad_edge=False)
    for parameter in spec.parameters.values():
        default = "" if parameter.required else repr(parameter.default)
        table.add_row(parameter.name, literal(parameter.type), literal(default), literal(parameter.doc))
    out.print(table)
    out.print(
        f"kernel {spec.kernel}, reduction {spec.reduction}, scale {spec.scale:g}, tolerance {spec.tolerance:g} "
        f"{spec.unit}; every goal also takes name, weight, tolerance, at, window, sometime, kernel and reduction"
    )


@app.command()
def body(
    file: Annotated[
        Path | None, typer.Argument(metavar="FILE", help="A character (GLB, glTF), a robot (URDF) or a fitted body.")
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the fitted capsules to this file.")] = None,
    png: Annotated[Path | None, typer.Option(help="Draw the character and its capsules.")] = None,
    coverage: Annotated[float, typer.Option(help="Share of each link's surface inside its capsules, 0.5 to 1.")] = 1.0,
    max_capsules: Annotated[int, typer.Option(min=1, help="Capsules for each link, at most.")] = 1,
) -> None:
    """Fit capsules to a character or a robot; without FILE, print the radii of our body and their source."""
    if file is None:
        from scenes.body.body import DEFAULT_BODY

        _show_body(DEFAULT_BODY)
        return
    from scenes.body.proxies import Proxies, fit_proxies

    if file.suffix.lower() == ".json":
        if png is not None:
            raise UserError(f"'{file}' holds capsules without a mesh; --png draws the GLB or URDF file")
        proxies = Proxies.load(file)
    else:
        rig, joints = _rig(file)
        with err.status("fitting"):
            proxies = fit_proxies(rig, coverage, max_capsules, joints)
    _show_proxies(proxies)
    if json_file is not None:
        proxies.save(json_file)
        out.print(f"wrote {json_file}")
    if png is not None:
        from scenectl.view.rig import draw_proxies

        draw_proxies(rig, proxies, png)
        out.print(f"wrote {png}")


@app.command()
def check(
    tasks: Annotated[list[Path], typer.Argument(metavar="TASK...", help="Task files (TOML).")],
    allow_code: AllowCode = None,
) -> None:
    """Validate tasks without a model: keys, scene, start, path, goals, times and places."""
    from scenectl.tasks.schema import load_task
    from scenes.world.floor.polyline import path_length

    _allow(allow_code)
    for path in tasks:
        problem = load_task(path).build()
        walk = "" if problem.path is None else f", a walk of {path_length(problem.path):.1f} m"
        count = len(problem.objective.terms)
        goals = f"{count} goal" + ("" if count == 1 else "s")
        out.print(f"{path}: fine ({problem.seconds:g} s in '{problem.scene.name}', {goals}{walk})")


@app.command()
def run(
    task: TaskFile,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the results.")],
    samples: Annotated[int | None, typer.Option(min=1, help="Motions to make; the best comes first.")] = None,
    seed: Annotated[int | None, typer.Option(help="Instead of the task's own.")] = None,
    weights: Annotated[str | None, typer.Option(help="Weights to use instead of the task's.")] = None,
    preview: Annotated[bool, typer.Option(help="Draw preview.png.")] = True,
    allow_code: AllowCode = None,
) -> None:
    """Make motions for a task: motion.npz, report.json and preview.png in DIR."""
    from scenectl.pipeline.run import run as make
    from scenectl.tasks.schema import load_task

    _allow(allow_code)
    loaded = load_task(task)
    if weights is not None:
        chosen = loaded.generator.model_copy(update={"weights": _resolved(weights)})
        loaded = loaded.model_copy(update={"generator": chosen})
    _writable(output)
    with bars() as progress:
        result = make(loaded, samples, seed, progress=progress)
        progress("writing", 0.0)
        result.save(output, preview=False)
        drawn = preview and _drawn(result, output / "preview.png")
    maker = result.report["generator"]
    out.print(literal(f"weights '{maker['weights']}': {maker['licence']}"))
    _show(result)
    out.print(f"wrote motion.npz, report.json{' and preview.png' if drawn else ''} in {output}")


@app.command()
def score(
    motion: Annotated[Path, typer.Argument(metavar="MOTION", help="motion.npz, or a folder that holds one.")],
    task: TaskFile,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the report to this file.")] = None,
    allow_code: AllowCode = None,
) -> None:
    """Report how well finished motions meet a task."""
    from scenectl.pipeline.run import score as judge
    from scenectl.tasks.schema import load_task
    from scenes.files import atomic_write
    from scenes.motion.motion import Motion

    _allow(allow_code)
    loaded = load_task(task)
    joints = Motion.load(motion / "motion.npz" if motion.is_dir() else motion)
    with bars() as progress:
        result = judge(joints, loaded, progress)
    _show(result)
    if json_file is not None:
        with atomic_write(json_file, "w") as file:
            json.dump(result.report, file, indent=1, allow_nan=False)


@app.command()
def view(
    what: Annotated[str, typer.Argument(metavar="DIR|SCENE", help="A result, a mesh file or a bundled scene.")],
    png: Annotated[Path | None, typer.Option(help="Draw into this file instead of a window.")] = None,
    sample: Annotated[int, typer.Option(min=0, help="Which motion of a result, 0 is the best.")] = 0,
    at: Annotated[float | None, typer.Option(help="One moment (s) instead of several.")] = None,
    show_slice: Annotated[bool, typer.Option("--slice", help="Show a slice of the distance field.")] = False,
    clearance: Annotated[bool, typer.Option(help="Colour the body by its distance to the scene.")] = False,
    signs: Annotated[bool, typer.Option("--signs", help="Show where it is uncertain which space is free.")] = False,
    allow_code: AllowCode = None,
) -> None:
    """Look at a result or a scene: body, goals, time slider, distances."""
    from scenectl import view as viewer

    if at is not None and not math.isfinite(at):
        raise UserError(f"--at is {at}; give a time in seconds")
    _allow(allow_code)
    folder = Path(what)
    picture = viewer.of_folder(folder, sample) if folder.is_dir() else viewer.of_scene(_scene(what))
    if png is not None:
        picture.draw(png, at=at, show_slice=show_slice, clearance=clearance, show_signs=signs)
        out.print(f"wrote {png}")
    else:
        picture.window(show_slice=show_slice, show_signs=signs)


def main() -> None:
    """Entry point of the `scenectl` command; exits with 2 for bad input."""
    try:
        app()
    except UserError as error:
        _leave(str(error))
    except BrokenPipeError:  # `scenectl goals | head` is no fault
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except OSError as error:
        name = f" '{error.filename}'" if error.filename else ""
        _leave(f"cannot use{name}: {error.strerror or error}")
    except MemoryError:
        _leave("not enough memory; use a smaller resolution, a shorter motion or fewer samples")


def _leave(sentence: str) -> None:
    err.print("scenectl: " + literal(" ".join(sentence.split())))
    sys.exit(2)


def _allow(path: Path | None) -> None:
    if path is not None:
        from scenectl.pipeline.run import allow_code

        allow_code(path)


def _resolved(weights: str) -> str:
    from scenectl.generators.mscot.bundle import bundled_weights

    return weights if weights in ("default", *bundled_weights()) else str(Path(weights).resolve())


def _scene(
    name: str,
    unit: str | None = None,
    up: str | None = None,
    resolution: int = 256,
    free_space: str = "auto",
    thickness: float = 0.0,
    spacing: float | None = None,
) -> Scene:
    """A scene by its bundled name or from a mesh file."""
    from scenes.world.scene import bundled, bundled_names, load_scene

    more: dict[str, Any] = {"thickness": thickness, "spacing": spacing}
    if name in bundled_names():
        return bundled(name, resolution=resolution, **more)
    if not Path(name).exists() and not Path(name).suffix:
        raise UserError(
            f"'{name}' is neither a file, a folder nor a bundled scene{did_you_mean(name, bundled_names())}"
        )
    return load_scene(name, unit, up, resolution=resolution, free_space=_free_space(free_space), **more)


def _free_space(text: str) -> Any:
    if text in ("auto", "outside"):
        return text
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError as error:
        raise UserError(f"--free-space is '{text}'; give auto, outside, or x,y,z in metres") from error
    return x, y, z


def _rig(file: Path) -> tuple[Rig, dict[str, str] | None]:
    """A character or robot from its file, and which of its links are our 22 joints, where it has them."""
    from scenectl.data.joint_names import match_joints
    from scenes.body.fit import fits
    from scenes.body.gltf import read_rig
    from scenes.body.urdf import read_urdf

    readers = {".glb": read_rig, ".gltf": read_rig, ".urdf": read_urdf, ".xml": read_urdf}
    if file.suffix.lower() not in readers:
        raise UserError(f"'{file}' is neither a character (.glb, .gltf), a robot (.urdf) nor a fitted body (.json)")
    rig = readers[file.suffix.lower()](file)
    try:
        joints = {joint: rig.links[index] for joint, index in match_joints(rig.links).items()}
    except UserError:  # a robot, or a creature
        return rig, None
    return rig, joints if fits(joints) else None


def _show_body(body: ProxyBody) -> None:
    """The radii of a body for the 22 joints, and where they come from."""
    table = Table("part", "radius (m)", "from", box=None, pad_edge=False)
    for row in body.table():
        table.add_row(literal(str(row["part"])), f"{row['radius_m']:.3f}", literal(str(row["origin"])))
    out.print(table)
    out.print(f"\nSource: {literal(body.source)}")
    out.print(f"The sole lies {body.sole_offset:.3f} m below the lowest foot joint of a person at rest.")


def _show_proxies(proxies: Proxies) -> None:
    """Every link's capsules and how tightly they fit, and all together."""
    table = Table(
        "link", "capsules", "radius (m)", "length (m)", "volume ratio", "of", "uncovered (mm)", box=None, pad_edge=False
    )
    for part in proxies.parts:
        table.add_row(
            literal(part.link),
            str(len(part.capsules)),
            " ".join(f"{capsule.radius:.3f}" for capsule in part.capsules),
            " ".join(f"{capsule.length:.3f}" for capsule in part.capsules),
            f"{part.volume_ratio:.2f}" if math.isfinite(part.volume_ratio) else "flat",
            part.reference,
            f"{1000 * part.uncovered:.1f}",
        )
    out.print(table)
    ratio = f"{proxies.volume_ratio:.2f} times their volume" if math.isfinite(proxies.volume_ratio) else "all flat"
    out.print(
        f"{literal(proxies.name)}: {len(proxies.capsules)} capsules on {len(proxies.parts)} of {len(proxies.links)} "
        f"links, {ratio}, nothing more than {1000 * proxies.uncovered:.1f} mm outside"
    )
    if proxies.body is not None:
        out.print(f"as a body of our 22 joints: {literal(proxies.body.source)}")


def _drawn(result: Result, png: Path) -> bool:
    """Draw the preview; where that cannot be done, the motion is still worth having."""
    from scenectl.view import draw_result

    try:
        draw_result(result, png)
    except UserError as error:
        err.print(literal(f"scenectl: no preview.png, because {error}"))
        return False
    return True


def _writable(folder: Path) -> None:
    """Find out before minutes of work, not after."""
    if folder.exists() and not folder.is_dir():
        raise UserError(f"'{folder}' is a file; give -o a folder")
    folder.mkdir(parents=True, exist_ok=True)
    if not os.access(folder, os.W_OK):
        raise UserError(f"cannot write into '{folder}': permission denied")


def _show(result: Result) -> None:
    """The samples in a table, the best one's goals in sentences."""
    table = Table("rank", "cost", "goals met", "deepest (mm)", "in the floor (mm)", "skating", box=None, pad_edge=False)
    for rank, row in enumerate(result.samples):
        met = sum(term.met for term in row.terms)
        deep, floor, skating = (
            row.metrics[key] for key in ("deepest_penetration_m", "deepest_floor_penetration_m", "skating_ratio")
        )
        table.add_row(
            str(rank),
            f"{row.cost:.4g}",
            f"{met} of {len(row.terms)}",
            f"{1000 * float(deep or 0):.0f}",
            f"{1000 * float(floor or 0):.0f}",
            f"{float(skating or 0):.2f}",
        )
    out.print(table)
    for term in result.samples[0].terms:
        out.print("  " + literal(term.sentence()))
    if (why := result.samples[0].diagnosis) is not None:
        out.print("  why: " + literal(why))


if __name__ == "__main__":
    main()
