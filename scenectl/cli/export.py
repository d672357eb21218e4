"""`scenectl export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from scenectl.cli.clock import importing
from scenectl.console.console import doubt
from scenectl.console.options import FromFps, FromUnit, FromUp, Joints, MotionFile, SceneFile, motion_read, scene_of
from scenectl.console.results import show_exported
from scenes.errors import UserError


def export(
    motion: MotionFile,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help=".bvh, .glb, .vrm, .usd, .usda, .usdc, .csv or .npz.")
    ],
    room: SceneFile = None,
    sample: Annotated[int | None, typer.Option(min=0, help="Which motion of a result; the best by default.")] = None,
    every: Annotated[bool, typer.Option("--all", help="All motions: in one file where the format holds them.")] = False,
    fps: Annotated[float | None, typer.Option(help="Frames a second of FILE; the motion's by default.")] = None,
    root_motion: Annotated[
        str, typer.Option(metavar="on|off", help="Whether the root walks, or stays over the place of its first frame.")
    ] = "on",
    names: Annotated[str, typer.Option(help="Of joints: humanml, mixamo, unreal, unity, vrm or soma.")] = "humanml",
    up: Annotated[str | None, typer.Option(help="FILE's axis that is up: y or z.")] = None,
    unit: Annotated[str | None, typer.Option(help="Of FILE: m, cm, mm, in or ft.")] = None,
    scene: Annotated[
        bool, typer.Option("--scene", help="With the scene: SCENE, or else that of the result's report.")
    ] = False,
    layout: Annotated[str | None, typer.Option(help="Of an .npz file: joints or bodies.")] = None,
    character: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A skinned character (.glb, .vrm) that plays the motion.")
    ] = None,
    joints: Joints = None,
    from_fps: FromFps = None,
    from_unit: FromUnit = None,
    from_up: FromUp = None,
) -> None:
    """Write a motion as a file that other tools open: BVH, glTF, USD, CSV or NumPy."""
    with importing():
        from scenectl.data.formats.motions import one_of
        from scenectl.data.joint_names import read_mapping
        from scenectl.export.export import check, export as write
        from scenectl.export.settings import Settings

    if root_motion not in ("on", "off"):
        raise UserError(f"--root-motion is '{root_motion}'; give on or off")
    if every and sample is not None:
        raise UserError("--all and --sample exclude each other; leave one out")
    if motion.is_dir() and (from_fps, from_unit, from_up) != (None, None, None):
        raise UserError(f"--from-... are for files of others, and '{motion}' is a result; leave them out")
    mapping = None if joints is None else read_mapping(joints)
    stated: dict[str, Any] = {"fps": fps, "names": names, "up": up, "unit": unit, "layout": layout}
    settings = Settings(root_motion=root_motion == "on", character=character, joints=mapping, **stated)
    check(settings, output)
    made = motion_read(motion, from_fps, from_unit, from_up)
    made = made if every else one_of(made, sample or 0, motion)
    room_of = scene_of(motion, room, sample or 0) if scene or room is not None else None
    if room is not None and room_of is not None:  # a result's own was doubted when it was made
        doubt(room_of.doubts_so_far)
    show_exported(write(made, output, settings, scene=room_of))
