"""`scenectl retarget`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scenectl.cli.clock import importing
from scenectl.console.console import doubt, err, out, table
from scenectl.console.options import MotionFile, motion_read
from scenes.errors import UserError

if TYPE_CHECKING:
    from scenectl.retarget.robots.humanoid import Humanoid
    from scenectl.retarget.robots.trajectory import Trajectory
    from scenes.world.scene import Scene

_FOREIGN = "Of MOTION, where its file does not say"


def retarget(
    motion: MotionFile,
    robot: Annotated[Path, typer.Option(metavar="FILE", help="A humanoid robot: MJCF (.xml) or URDF.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help=".csv or .npz; nothing is written without.")
    ] = None,
    sample: Annotated[int, typer.Option(min=0, help="Which motion of a result; the best by default.")] = 0,
    fps: Annotated[float, typer.Option(help="Frames a second of the trajectory.")] = 50.0,
    layout: Annotated[
        str, typer.Option(help="Of FILE: named; lafan1 (.csv); gmr, mjlab or isaaclab (.npz).")
    ] = "named",
    joints: Annotated[
        Path | None,
        typer.Option(metavar="MAPPING", help="TOML: which body is which of our joints, where names don't tell."),
    ] = None,
    speed: Annotated[
        float | None, typer.Option(help="Largest speed of joints (rad/s) whose file states none; 3 pi by default.")
    ] = None,
    scene: Annotated[
        bool, typer.Option(help="Stay out of the scene that MOTION was made in, where it is a result's folder.")
    ] = True,
    report: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the feasibility report as JSON.")] = None,
    png: Annotated[Path | None, typer.Option(help="Draw the robot in its scene.")] = None,
    gif: Annotated[Path | None, typer.Option(help="Animate the robot in its scene.")] = None,
    from_fps: Annotated[float | None, typer.Option(help=f"{_FOREIGN}: frames a second.")] = None,
    from_unit: Annotated[str | None, typer.Option(help=f"{_FOREIGN}: m, cm, mm, in or ft.")] = None,
    from_up: Annotated[str | None, typer.Option(help=f"{_FOREIGN}: the axis that is up, x, y or z.")] = None,
) -> None:
    """Make a humanoid robot follow a motion, within the ranges and speeds of its joints."""
    with importing():
        from scenectl.console.feasibility import show_feasibility
        from scenectl.retarget.robots.feasibility import feasibility
        from scenectl.retarget.robots.files import check, write
        from scenectl.retarget.robots.humanoid import SPEED
        from scenectl.retarget.robots.robot import Robot
        from scenes.files import read_toml

    if output is not None:
        check(output, layout)
    mapping = None if joints is None else read_toml(joints, "joint mapping")
    if mapping is not None and not all(isinstance(name, str) for name in mapping.values()):
        raise UserError(f"joint mapping '{joints}' is no table of names; write lines such as left_knee = \"shin_l\"")
    machine = Robot(robot, mapping, SPEED if speed is None else speed)
    doubt(machine.doubts)
    made = motion_read(motion, from_fps, from_unit, from_up)
    if made.joints.ndim == 4:
        if sample >= len(made.joints):
            raise UserError(f"--sample {sample}: '{motion}' holds {len(made.joints)} motions, counted from 0")
        made = made[sample]
    elif sample:
        raise UserError(f"--sample {sample}: '{motion}' holds one motion")
    _show_robot(machine)
    around = _scene_of(motion) if scene else None
    with err.status("retargeting"):
        trajectory = machine.retarget(made, fps, around)
        found = feasibility(trajectory, around)
    _show(trajectory)
    show_feasibility(found)
    if report is not None:
        found.save(report)
        out.print(f"wrote {report}")
    _draw(trajectory, around, png, gif)
    if output is not None:
        write(trajectory, output, layout)
        out.print(f"wrote {output}")


def _scene_of(motion: Path) -> Scene | None:
    """The scene that a result was made in; None for a motion alone."""
    if not (motion / "report.json").is_file():
        return None
    from scenectl.pipeline.results import load_result
    from scenectl.tasks.task import Task

    return Task(**load_result(motion)[1]["task"]).load_scene()


def _draw(trajectory: Trajectory, scene: Scene | None, png: Path | None, gif: Path | None) -> None:
    """The pictures that were asked for."""
    if png is None and gif is None:
        return
    from scenectl.view.robots import Replay, lowest
    from scenes.world.scene import Scene

    replay = Replay(trajectory, scene if scene is not None else Scene.empty(lowest(trajectory)))
    for path, draw in ((png, replay.draw), (gif, replay.animate)):
        if path is not None:
            with err.status("drawing"):
                draw(path)
            out.print(f"wrote {path}")


def _show_robot(robot: Humanoid) -> None:
    """Which body moves as which of our joints."""
    lines = table("our joint", "body")
    for joint, body in robot.joints.items():
        lines.add_row(joint, body)
    out.print(lines)
    states = f"{robot.stated.sum()} of {len(robot.names)} speeds stated by the file"
    assumed = "" if robot.stated.all() else f", {robot.speeds[~robot.stated].max():.2f} rad/s assumed for the others"
    out.print(f"{robot.name}: {len(robot.names)} joints, legs of {robot.points.legs:.2f} m; {states}{assumed}")


def _show(trajectory: Trajectory) -> None:
    """How near the robot comes to what it follows, and what kept it away."""
    figures = trajectory.figures()
    lines = table("joint", "median (cm)", "95 % (cm)")
    for name, off in figures.off.items():
        lines.add_row(name, f"{100 * off[0]:.1f}", f"{100 * off[1]:.1f}")
    out.print(lines)
    out.print(
        f"{trajectory.frames} frames at {trajectory.fps:g} a second; standing feet slide {100 * figures.slide:.1f} cm "
        f"at most; joints move at up to {100 * figures.speed:.0f} % of their speeds"
    )
    if figures.limited:
        listed = ", ".join(f"{name} ({100 * share:.0f} %)" for name, share in figures.limited.items())
        out.print(f"held at an end of their ranges or at their speeds, of the frames: {listed}")
