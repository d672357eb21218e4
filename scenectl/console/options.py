"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scenes.errors import UserError

if TYPE_CHECKING:
    from scenes.motion.motion import Motion
    from scenes.world.scene import Scene

TaskFile = Annotated[Path, typer.Argument(metavar="TASK", help="A task file (TOML).")]
MotionFile = Annotated[
    Path, typer.Argument(metavar="MOTION", help="A result's folder, or joints or features: .npz, .npy or .bvh.")
]
SceneFile = Annotated[
    str | None, typer.Argument(metavar="[SCENE]", help="The scene's file, where it is not a result's own.")
]
Fps = Annotated[float | None, typer.Option(help="Frames a second of the motion, where its file does not say.")]
Unit = Annotated[str | None, typer.Option(help="Of the file: m, cm, mm, in or ft.")]
Up = Annotated[str | None, typer.Option(help="The file's axis that is up: x, y or z.")]
_FOREIGN = "Of MOTION, where its file does not say"
FromFps = Annotated[float | None, typer.Option(help=f"{_FOREIGN}: frames a second.")]
FromUnit = Annotated[str | None, typer.Option(help=f"{_FOREIGN}: m, cm, mm, in or ft.")]
FromUp = Annotated[str | None, typer.Option(help=f"{_FOREIGN}: the axis that is up, x, y or z.")]
"""For commands whose --fps, --unit and --up are about what they write."""
Joints = Annotated[
    Path | None,
    typer.Option(metavar="MAPPING", help="TOML or JSON: {our joint: theirs}, where names don't tell."),
]
AllowCode = Annotated[
    Path | None,
    typer.Option("--allow-code", metavar="FILE.py", help="Run this file for its @goal and @action functions."),
]
AllowUnmet = Annotated[
    bool, typer.Option("--allow-unmet", help="Exit with 0, not 3, where no sample is both met and believable.")
]
GENERATOR = "mscot"
"""The default, as in `scenectl.generators.registry`, which help does not import."""
Data = Annotated[Path, typer.Option("--data", help="Recorded motions: a collection, or HumanML3D (docs/formats.md).")]
Json = Annotated[Path | None, typer.Option("--json", help='Write {"summary": ..., "rows": [...]} to this file.')]
Weights = Annotated[str, typer.Option(help="Weights: 'default', 'permissive' or a folder.")]
Generator = Annotated[str, typer.Option(help="A registered generator.")]
Generators = Annotated[
    list[str] | None, typer.Option("--generator", help=f"A registered generator; repeatable. Default: {GENERATOR}.")
]
Shard = Annotated[
    str | None,
    typer.Option(metavar="I/N", help="Measure every N-th case, from the I-th on (from 0); N processes share --json."),
]
Seed = Annotated[int, typer.Option(help="Of everything random.")]
Threads = Annotated[int | None, typer.Option(min=1, max=256, help="CPU threads; one by default.")]
DATA = Path("../shared/data/motions")


def motion_read(path: Path, fps: float | None, unit: str | None, up: str | None) -> Motion:
    """The motion in a file of any kind; what was decided about it, and what is in doubt, is told."""
    from scenectl.console.console import doubt, note
    from scenectl.data.formats.motions import read_motion

    reading = read_motion(path, fps, unit, up)
    note(reading.notes)
    doubt(reading.doubts)
    return reading.motion


def is_result(motion: Path) -> bool:
    """Whether it is a folder that `scenectl run` wrote, whose report tells of a task."""
    return (motion / "report.json").is_file()


def scene_of(motion: Path, room: str | None, sample: int = 0) -> Scene:
    """The scene in a file or of a name, or else that of a result's report, with what one of its motions holds.

    Raises UserError where there is none.
    """
    from scenectl.pipeline.results import load_result, task_of
    from scenes.world.named import named_scene

    if room is not None:
        return named_scene(room)
    if not is_result(motion):
        raise UserError(f"'{motion}' is no result whose report tells of a scene; give its file, as in --scene room.glb")
    made, report = load_result(motion)
    return task_of(report).scene_of(made[sample] if made.joints.ndim == 4 else made)


def allow(path: Path | None) -> None:
    """Run what `--allow-code` names."""
    if path is not None:
        from scenectl.tasks.code import allow_code

        allow_code(path)
