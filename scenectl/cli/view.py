"""`scenectl view`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from scenectl.cli.clock import importing
from scenectl.console.console import out
from scenectl.console.options import AllowCode, Fps, Unit, Up, allow, motion_read
from scenes.errors import UserError


def view(
    what: Annotated[
        str, typer.Argument(metavar="DIR|MOTION|SCENE", help="A result, a motion, a mesh file or a scene.")
    ],
    png: Annotated[Path | None, typer.Option(help="Draw into this file instead of a window.")] = None,
    sample: Annotated[int, typer.Option(min=0, help="Which motion of a result, 0 is the best.")] = 0,
    at: Annotated[float | None, typer.Option(help="One moment (s) instead of several.")] = None,
    show_slice: Annotated[bool, typer.Option("--slice", help="Show a slice of the distance field.")] = False,
    clearance: Annotated[bool, typer.Option(help="Colour the body by its distance to the scene.")] = False,
    signs: Annotated[bool, typer.Option("--signs", help="Show where it is uncertain which space is free.")] = False,
    allow_code: AllowCode = None,
    fps: Fps = None,
    unit: Unit = None,
    up: Up = None,
) -> None:
    """Look at a result, a motion or a scene: body, goals, time slider, distances."""
    with importing():
        from scenectl import view as viewer
        from scenectl.data.formats.motions import SUFFIXES as MOTIONS, one_of
        from scenes.world.named import named_scene

    if at is not None and not math.isfinite(at):
        raise UserError(f"--at is {at}; give a time in seconds")
    allow(allow_code)
    path = Path(what)
    if path.is_dir() and (fps, unit, up) != (None, None, None):
        raise UserError(f"--fps, --unit and --up are for files of others, and '{what}' is a result; leave them out")
    if path.is_dir():
        picture = viewer.of_folder(path, sample)
    elif path.suffix.lower() in MOTIONS:
        picture = viewer.of_motion(one_of(motion_read(path, fps, unit, up), sample, path), path.name)
    elif path.suffix.lower() == ".toml":
        raise UserError(f"'{what}' is a task; make motions with scenectl run, and view their folder")
    elif fps is not None:
        raise UserError(f"--fps is for motions ({', '.join(MOTIONS)}), and '{what}' is a scene; leave it out")
    else:
        picture = viewer.of_scene(named_scene(what, unit, up))
    if png is not None:
        picture.draw(png, at=at, show_slice=show_slice, clearance=clearance, show_signs=signs)
        out.print(f"wrote {png}")
    else:
        viewer.open_window(picture, show_slice=show_slice, show_signs=signs)
