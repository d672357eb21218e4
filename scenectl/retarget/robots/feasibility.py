"""Whether a robot can do what a trajectory says: limits that it uses, where it stands, what it hits, what it takes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from scenectl.retarget.robots.avoid import scene_distance
from scenectl.retarget.robots.capsules import capsules_of, carried, poses
from scenectl.retarget.robots.dynamics import Dynamics, dynamics, half_speeds, torques_of
from scenectl.retarget.robots.standing import last_of, standing
from scenectl.retarget.robots.trajectory import Trajectory
from scenes.body.capsules import sample_surface
from scenes.body.mjcf import geom_solid, geoms_of
from scenes.files import write_json
from scenes.world.scene import Scene

_POINTS = 200
"""Points on each body's shapes that are asked how deep they are in the scene."""
_APART = 0.2
"""Seconds between stretches that are slowed down as one."""


@dataclass(frozen=True)
class Joint:
    """What a trajectory uses of a joint's limits; 1 is all of it.

    Attributes:
        name: of the joint.
        range_used: how near it comes to an end of its range, 0 in the middle; None where it has none.
        speed: largest, rad/s (m/s of slides).
        speed_used: of its limit.
        torque: largest, N m (N of slides).
        torque_used: of the limit in the file; None where there is none.
    """

    name: str
    range_used: float | None
    speed: float
    speed_used: float
    torque: float
    torque_used: float | None


@dataclass(frozen=True)
class Most:
    """The worst of something: how much (m), of what (a link, a pair, our joint), and when (s)."""

    metres: float = 0.0
    what: str = ""
    seconds: float = 0.0


@dataclass(frozen=True)
class Support:
    """A point over the support polygon, in the frames at which something stands.

    Attributes:
        inside: share of these frames at which the point is over the polygon; 1 where there is none.
        outside: the farthest (m) that it is outside.
        seconds: when.
    """

    inside: float
    outside: float
    seconds: float


@dataclass(frozen=True)
class Stretch:
    """A part of a trajectory that a robot can do only slower.

    Attributes:
        begin, end: seconds.
        factor: how many times longer it should take; infinite where holding still takes more than a motor has.
        why: the limit that asks most.
    """

    begin: float
    end: float
    factor: float
    why: str


@dataclass(frozen=True)
class Feasibility:
    """What a robot needs for a trajectory. `feasibility` finds it.

    Attributes:
        robot: its name.
        seconds: how long the trajectory is.
        joints: what it uses of each joint's limits.
        standing: share of frames at which a foot stands.
        slide: the farthest that a standing foot goes.
        turn: degrees that a standing foot turns on the ground at most.
        mass_centre, zmp: over the soles that stand: what holds still, and what moves.
        scene: how deep its shapes get into the scene, its soles into the ground as well.
        itself: how deep its capsules get into each other.
        missing_force, missing_moment: the most that no foot gives (N; N m).
        missing_seconds: when the force is missing.
        weight: newtons.
        stretches: what to slow down.
        doubts: what is not known, one sentence each.
    """

    robot: str
    seconds: float
    joints: tuple[Joint, ...]
    standing: float
    slide: Most
    turn: float
    mass_centre: Support
    zmp: Support
    scene: Most | None
    itself: Most
    missing_force: float
    missing_moment: float
    missing_seconds: float
    weight: float
    stretches: tuple[Stretch, ...]
    doubts: tuple[str, ...]

    @property
    def within(self) -> bool:
        """Whether no limit of a joint is exceeded."""
        used = [x for joint in self.joints for x in (joint.range_used, joint.speed_used, joint.torque_used)]
        return all(x is None or x <= 1 for x in used)

    def save(self, path: str | Path) -> None:
        """Write everything as JSON; a factor that is infinite is null."""
        table: dict[str, Any] = asdict(self) | {"within_limits": self.within}
        for stretch in table["stretches"]:
            stretch["factor"] = stretch["factor"] if math.isfinite(stretch["factor"]) else None
        write_json(table, path, allow_nan=False)

    def sentences(self) -> Iterator[str]:
        """What is wrong or near it, a sentence each."""
        support, ground = self.mass_centre, self.zmp
        if self.standing:
            yield (
                f"it stands in {self.standing:.0%} of all frames, its centre of mass over its soles in "
                f"{support.inside:.0%} of these, at most {support.outside:.3f} m outside ({support.seconds:.2f} s); "
                f"its zero-moment point in {ground.inside:.0%}, at most {ground.outside:.3f} m outside "
                f"({ground.seconds:.2f} s)"
            )
            slid = f"{self.slide.metres:.3f} m{_at(self.slide)}"
            yield f"standing feet slide {slid} and turn {self.turn:.0f} degrees at most"
        if self.scene is not None:
            yield f"it is at most {self.scene.metres:.3f} m deep in the scene{_at(self.scene)}"
        yield f"it is at most {self.itself.metres:.3f} m deep in itself{_at(self.itself)}"
        if self.missing_force > 0.01 * self.weight or self.missing_moment > 0.01 * self.weight:
            yield (
                f"the soles that stand leave {self.missing_force:.0f} N of {self.weight:.0f} N of weight and "
                f"{self.missing_moment:.0f} N m without support at most ({self.missing_seconds:.2f} s)"
            )
        for part in self.stretches:
            span = f"{part.begin:.2f} to {part.end:.2f} s"
            if math.isfinite(part.factor):
                yield f"slow {span} down {part.factor:.2f} times: {part.why}"
            else:
                yield f"{span} cannot be held at any speed: {part.why}"
        yield from self.doubts


def _at(most: Most) -> str:
    return f" ({most.what}, {most.seconds:.2f} s)" if most.what else ""


def feasibility(
    trajectory: Trajectory, scene: Scene | None = None, torques: Mapping[str, float | int] | None = None
) -> Feasibility:
    """What a robot needs for a trajectory.

    Args:
        trajectory: of the robot.
        scene: y up, that it moves in; None leaves penetration out.
        torques: {joint: its largest, N m (N of slides)}, instead of the file's.

    Raises:
        UserError: a torque that is not positive, or of a joint that the robot lacks.
    """
    feet = standing(trajectory, scene)
    forces = dynamics(trajectory, feet)
    robot, limits, fps = trajectory.robot, torques_of(trajectory.robot, torques or {}), trajectory.fps
    slide, joint, frame = last_of(feet.slides())
    force, moment = (np.linalg.norm(forces.missing[:, part], axis=1) for part in (slice(3), slice(3, 6)))
    doubts = []
    if without := np.flatnonzero(~np.isfinite(limits)).size:
        doubts.append(
            f"'{robot.source}' states no torque limit for {without} of {len(limits)} joints; state some, or none is "
            "taken there"
        )
    if not robot.stated.all():
        slow = sorted(set(np.round(robot.speeds[~robot.stated], 2).tolist()))
        doubts.append(
            f"it states no speed limit for {int((~robot.stated).sum())} of {len(limits)} joints; "
            f"{', '.join(f'{speed:g}' for speed in slow)} rad/s is taken there"
        )
    return Feasibility(
        robot.name,
        (trajectory.frames - 1) / fps,
        _joints(trajectory, forces, limits),
        float(feet.standing.mean()),
        Most(slide, joint, frame / fps),
        last_of(feet.turns())[0],
        _support(feet.outside(forces.mass_centre[:, :2]), feet.standing, fps),
        _support(feet.outside(forces.zmp), feet.standing, fps),
        None if scene is None else scene_depth(trajectory, scene),
        self_depth(trajectory),
        float(force.max()),
        float(moment.max()),
        float(force.argmax() / fps),
        forces.weight,
        tuple(stretches(trajectory, forces, limits)),
        tuple(doubts),
    )


def _joints(trajectory: Trajectory, forces: Dynamics, limits: Float[np.ndarray, " n"]) -> tuple[Joint, ...]:
    robot, joints = trajectory.robot, trajectory.qpos[:, 7:]
    middle, half = robot.ranges.mean(axis=1), np.ptp(robot.ranges, axis=1) / 2
    speeds = np.abs(half_speeds(trajectory)[:, 6:]).max(axis=0, initial=0.0)
    torques = np.abs(forces.torques).max(axis=0)
    found = []
    for i, name in enumerate(robot.names):
        ends = np.isfinite(robot.ranges[i]).all() and half[i] > 0
        used = float(np.abs(joints[:, i] - middle[i]).max() / half[i]) if ends else None
        torque = float(torques[i] / limits[i]) if np.isfinite(limits[i]) else None
        speed = float(speeds[i])
        found.append(Joint(name, used, speed, speed / float(robot.speeds[i]), float(torques[i]), torque))
    return tuple(found)


def _support(away: Float[np.ndarray, " T"], stands: Bool[np.ndarray, " T"], fps: float) -> Support:
    if not stands.any():
        return Support(1.0, 0.0, 0.0)
    away = np.where(stands & np.isfinite(away), away, -1.0)  # no zero-moment point where nothing is pressed
    known = away >= 0
    inside = float((away[known] <= 0).mean()) if known.any() else 1.0
    return Support(inside, max(float(away.max()), 0.0), float(away.argmax() / fps))


def stretches(trajectory: Trajectory, forces: Dynamics, limits: Float[np.ndarray, " n"]) -> Iterator[Stretch]:
    """Parts that have to be slower, each by the factor at which all limits of joints hold.

    Taking s times as long divides speeds by s and what a torque is more than that of holding still by s^2: forces at
    the feet that carry the robot still, and moving, also carry it in any mixture of both.
    """
    factors, asking = slower(trajectory, forces, limits)
    slow = np.flatnonzero(factors > 1 + 1e-6)
    if not len(slow):
        return
    fps = trajectory.fps
    for part in np.split(slow, np.flatnonzero(np.diff(slow) > max(_APART * fps, 1)) + 1):
        worst = int(part[factors[part].argmax()])
        why = f"{asking[worst]} ({worst / fps:.2f} s)"
        yield Stretch(float(part[0] / fps), float(part[-1] / fps), float(factors[worst]), why)


def slower(
    trajectory: Trajectory, forces: Dynamics, limits: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " T"], list[str]]:
    """How many times longer each frame would have to take, 1 at least, and for what."""
    robot, steps = trajectory.robot, np.abs(half_speeds(trajectory)[:, 6:]) / trajectory.robot.speeds
    speed = np.zeros(forces.torques.shape)
    speed[:-1] = steps
    speed[1:] = np.maximum(speed[1:], steps)
    more, room = forces.torques - forces.still, limits - np.abs(forces.still)
    with np.errstate(divide="ignore", invalid="ignore"):
        # the largest share of `more` that fits on its side of what holding still takes
        share = np.where(more == 0, np.inf, (limits - np.sign(more) * forces.still) / np.abs(more))
        torque = np.where(room < 0, np.inf, 1 / np.sqrt(share))
    torque = np.where(np.isfinite(limits), torque, 0.0)
    both = np.concatenate([speed, torque], axis=1)
    worst, count = both.argmax(axis=1), len(robot.names)
    told = [
        f"{robot.names[k]} turns at {speed[t, k] * robot.speeds[k]:.1f} of {robot.speeds[k]:.1f} rad/s"
        if k < count
        else f"{robot.names[k - count]} takes {np.abs(forces.torques[t, k - count]):.0f} of {limits[k - count]:.0f} N m"
        for t, k in enumerate(worst)
    ]
    return np.maximum(both.max(axis=1), 1.0), told


def self_depth(trajectory: Trajectory) -> Most:
    """How deep the robot's capsules are in each other, of `Capsules.pairs`."""
    capsules, found = capsules_of(trajectory.robot), [(0.0, "", 0)]
    for frame, places in enumerate(capsules.placed(*poses(capsules.model, trajectory.qpos))):
        gaps = capsules.self_distances(places, 0.0)
        if len(gaps.distance) and (least := float(gaps.distance.min())) < 0:
            a, b = capsules.pairs[gaps.pairs[gaps.distance.argmin()]]
            found.append((-least, f"{capsules.links[a]} and {capsules.links[b]}", frame))
    depth, what, frame = last_of(found)
    return Most(depth, what, frame / trajectory.fps)


def scene_depth(trajectory: Trajectory, scene: Scene) -> Most:
    """How deep points on the robot's shapes are in a scene.

    Bodies are asked only at frames at which one of their capsules, which hold them, is not clear of the scene.
    """
    capsules = capsules_of(trajectory.robot)
    points, owners = capsules.samples
    places, turns = poses(capsules.model, trajectory.qpos)
    times = trajectory.t0 + np.arange(trajectory.frames) / trajectory.fps
    bodies = capsules.bodies[owners]
    away, _ = scene_distance(scene, carried(places, turns, bodies, points), times[:, None])
    reaching = away < 1.25 * capsules.radii[owners]  # a sample stands for half a radius on either side
    found = [(0.0, "", 0)]
    for body in np.unique(bodies).tolist():
        frames = np.flatnonzero(reaching[:, bodies == body].any(axis=1))
        if not len(frames):
            continue
        surface = _surface(capsules.model, body)
        where = carried(places[frames], turns[frames], np.full(len(surface), body), surface)
        depth = -scene_distance(scene, where, times[frames, None])[0].min(axis=1)
        found.append((float(depth.max()), str(capsules.model.body(body).name), int(frames[depth.argmax()])))
    depth, what, frame = last_of(found)
    return Most(depth, what, frame / trajectory.fps)


def _surface(model: Any, body: int) -> Float[np.ndarray, "n 3"]:
    """Corners and other points of a body's shapes, in its frame, metres."""
    collides, seen = geoms_of(model, body)
    points = []
    for vertices, faces in (geom_solid(model, geom) for geom in collides or seen):
        points += [vertices[:: 1 + len(vertices) // _POINTS], sample_surface(vertices, faces, _POINTS)]
    return np.concatenate(points)
