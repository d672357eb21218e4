"""`scenectl retarget`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from scenectl.cli.clock import importing
from scenectl.console.console import doubt, err, out, table
from scenectl.console.options import (
    FromFps,
    FromUnit,
    FromUp,
    Joints,
    MotionFile,
    SceneFile,
    is_result,
    motion_read,
    scene_of,
)
from scenes.errors import UserError

if TYPE_CHECKING:
    from scenectl.retarget.robots.robot import Robot
    from scenectl.retarget.robots.trajectory import Trajectory
    from scenes.motion.motion import Motion
    from scenes.world.scene import Scene


def retarget(
    motion: MotionFile,
    robot: Annotated[Path, typer.Option(metavar="FILE", help="A humanoid robot: MJCF (.xml) or URDF.")],
    room: SceneFile = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help=".csv or .npz; nothing is written without.")
    ] = None,
    sample: Annotated[int | None, typer.Option(min=0, help="Which motion of a result; the best by default.")] = None,
    every: Annotated[
        bool, typer.Option("--all", help="All motions of a result: files of each, NAME_0 and so on.")
    ] = False,
    fps: Annotated[float, typer.Option(help="Frames a second of the trajectory.")] = 50.0,
    layout: Annotated[
        str, typer.Option(help="Of FILE: named; lafan1 (.csv); gmr, mjlab or isaaclab (.npz).")
    ] = "named",
    joints: Joints = None,
    speed: Annotated[
        float | None, typer.Option(help="Largest speed of joints (rad/s) whose file states none; 3 pi by default.")
    ] = None,
    torques: Annotated[
        Path | None, typer.Option(metavar="FILE", help="TOML: joint = N m, for the report; the robot's file otherwise.")
    ] = None,
    scene: Annotated[
        bool | None,
        typer.Option(help="Stay out of SCENE, or else of that of the result's report; by default where there is one."),
    ] = None,
    report: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the feasibility report as JSON.")] = None,
    png: Annotated[Path | None, typer.Option(help="Draw the robot in its scene.")] = None,
    gif: Annotated[Path | None, typer.Option(help="Animate the robot in its scene.")] = None,
    from_fps: FromFps = None,
    from_unit: FromUnit = None,
    from_up: FromUp = None,
) -> None:
    """Make a humanoid robot follow a motion, within the ranges and speeds of its joints."""
    with importing():
        from scenectl.data.formats.motions import one_of
        from scenectl.data.joint_names import read_mapping
        from scenectl.retarget.robots.dynamics import torques_of
        from scenectl.retarget.robots.files import check
        from scenectl.retarget.robots.humanoid import SPEED
        from scenectl.retarget.robots.robot import Robot
        from scenes.files import read_toml

    if output is not None:
        check(output, layout)
    if every and sample is not None:
        raise UserError("--all and --sample exclude each other; leave one out")
    if room is not None and scene is False:
        raise UserError(f"--no-scene leaves out '{room}'; leave one of them out")
    around = scene_of(motion, room) if scene or room or (scene is None and is_result(motion)) else None
    mapping = None if joints is None else read_mapping(joints)
    machine = Robot(robot, mapping, SPEED if speed is None else speed)
    doubt(machine.doubts)
    limits = {} if torques is None else read_toml(torques, "torque file")
    torques_of(machine, limits)
    made = motion_read(motion, from_fps, from_unit, from_up)
    several = every and made.joints.ndim == 4 and len(made.joints) > 1
    chosen = list(range(len(made.joints))) if several else [sample or 0]
    motions = [one_of(made, index, motion) for index in chosen]
    _show_robot(machine)
    for index, one in zip(chosen, motions, strict=True):
        if several:
            out.print(f"motion {index}")
        files = [
            file if file is None or not several else file.with_stem(f"{file.stem}_{index}")
            for file in (output, report, png, gif)
        ]
        _followed(machine, one, fps, around, limits, layout, *files)


def _followed(
    machine: Robot,
    motion: Motion,
    fps: float,
    around: Scene | None,
    torques: dict[str, Any],
    layout: str,
    output: Path | None,
    report: Path | None,
    png: Path | None,
    gif: Path | None,
) -> None:
    """Make a robot follow one motion, and tell, write and draw it."""
    from scenectl.console.feasibility import show_feasibility
    from scenectl.retarget.robots.feasibility import feasibility
    from scenectl.retarget.robots.files import write

    with err.status("retargeting"):
        trajectory = machine.retarget(motion, fps, around)
        found = feasibility(trajectory, around, torques)
    _show(trajectory)
    show_feasibility(found)
    if report is not None:
        found.save(report)
        out.print(f"wrote {report}")
    _draw(trajectory, around, png, gif)
    if output is not None:
        write(trajectory, output, layout)
        out.print(f"wrote {output}")


def _draw(trajectory: Trajectory, scene: Scene | None, png: Path | None, gif: Path | None) -> None:
    """The pictures that were asked for."""
    if png is None and gif is None:
        return
    from scenectl.view.robots import Replay

    replay = Replay.of(trajectory, scene)
    for path, draw in ((png, replay.draw), (gif, replay.animate)):
        if path is not None:
            with err.status("drawing"):
                draw(path)
            out.print(f"wrote {path}")


def _show_robot(robot: Robot) -> None:
    """Which body moves as which of our joints."""
    lines = table("our joint", "body")
    for joint, body in robot.joints.items():
        lines.add_row(joint, body)
    out.print(lines)
    states = f"{robot.stated.sum()} of {len(robot.names)} speeds stated by the file"
    assumed = "" if robot.stated.all() else f", {robot.speeds[~robot.stated].max():.2f} rad/s assumed for the others"
    out.print(f"{robot.name}: {len(robot.names)} joints, legs of {robot.points.legs:.2f} m; {states}{assumed}")
    out.print(f"motions of body = {{ height = {robot.stature:.2f} }} are of its size; it follows others scaled")


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
