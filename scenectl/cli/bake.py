"""`scenectl bake`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scenectl.cli.clock import importing
from scenectl.console.console import doubt, err, out
from scenes.errors import UserError, in_doubt

if TYPE_CHECKING:
    from scenes.sdf.settings import FreeSpace
    from scenes.world.scene import Scene


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
    with importing():
        from scenes.files import replaceable
        from scenes.world.named import named_scene

    for file in (output, png):
        if file is not None:
            replaceable(file)  # told before minutes of work
    begin = time.perf_counter()
    found = named_scene(
        scene, unit, up, resolution=resolution, free_space=_free_space(free_space), thickness=thickness, spacing=spacing
    )
    with err.status("baking"), in_doubt(lambda: found.doubts_so_far):
        grids = [result.grid for result in found.bakes]
    _show_bake(found)
    out.print(f"{_floors(found)}; done in {time.perf_counter() - begin:.1f} s")
    doubt(found.doubts)
    if output is not None:
        if len(grids) != 1:
            raise UserError(f"scene '{scene}' has {len(grids)} meshes; -o writes the grid of scenes with one")
        grids[0].save(output)
        out.print(f"wrote {output}")
    if png is not None:
        from scenectl.view import draw_scene

        draw_scene(found, png, show_slice=True)
        out.print(f"wrote {png}")


def _show_bake(scene: Scene) -> None:
    """What was decided, and each grid's size."""
    from scenes.sdf.grid import SdfGrid

    for line in scene.report():
        out.print(line)
    for grid in (result.grid for result in scene.bakes):
        size = " x ".join(str(n) for n in grid.shape)
        kept = "" if isinstance(grid, SdfGrid) else ", kept near surfaces only"
        out.print(f"grid: {size} nodes, spacing {1000 * grid.spacing:.1f} mm{kept}, {grid.nbytes / 1e6:.1f} MB")


def _floors(scene: Scene) -> str:
    """How high the floor lies, and the heights and areas of all where there are several; why there is none."""
    try:
        floor, floors = scene.floor, scene.floors
    except UserError as error:
        return str(error)
    where = "found in the mesh" if floor.found else "stated"
    told = ", ".join(f"{storey.height:.3f} m ({storey.area:.1f} m²)" for storey in floors)
    return f"floor: {floor.height:.3f} m ({where})" + (f"; floors: {told}" if len(floors) > 1 else "")


def _free_space(text: str) -> FreeSpace:
    if text == "auto" or text == "outside":
        return text
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError as error:
        raise UserError(f"--free-space is '{text}'; give auto, outside, or x,y,z in metres") from error
    return x, y, z
