"""What no person does, made from what one did: each with the checks whose sentence is right."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from scenectl.bench.studies.recordings import FLOOR, travel_speed
from scenes.body.body import DEFAULT_BODY
from scenes.mesh.primitives import Box
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D
from scenes.world.scene import Scene

Made = tuple[Motion, Scene]
WALKS = 0.5
"""Mean speed of the pelvis (m/s) from which on a clip walks."""


@dataclass(frozen=True)
class Absurdity:
    """One way to spoil a motion on a floor.

    Attributes:
        right: checks whose sentence names it.
        make: from the motion; None where the motion is not of the kind.
    """

    right: tuple[str, ...]
    make: Callable[[Motion, torch.Generator], Made | None]


def _uniform(draw: torch.Generator, low: float, high: float) -> float:
    return low + (high - low) * float(torch.rand((), generator=draw))


def _way(draw: torch.Generator) -> Tensor:
    """A direction over the ground."""
    angle = _uniform(draw, 0.0, 2 * math.pi)
    return torch.tensor([math.cos(angle), 0.0, math.sin(angle)], dtype=torch.float64)


def _bottom(joints: Tensor) -> Tensor:
    return (DEFAULT_BODY.points_of(joints)[..., 1] - DEFAULT_BODY.radii().double()).amin(-1)


def lifted(motion: Motion, draw: torch.Generator) -> Made:
    """All of it 5 cm higher."""
    return replace(motion, joints=motion.joints + motion.joints.new_tensor([0.0, 0.05, 0.0])), FLOOR


def into_wall(motion: Motion, draw: torch.Generator) -> Made:
    """A wall that it is 5 cm deep in where it goes furthest to one side."""
    axis, sign = (0, 2)[int(torch.randint(2, (), generator=draw))], (1, -1)[int(torch.randint(2, (), generator=draw))]
    points, radii = DEFAULT_BODY.points_of(motion.joints), DEFAULT_BODY.radii().double()
    face = sign * float((sign * points[..., axis] + radii).max()) - sign * 0.05
    middle = points.mean(dim=(0, 1))
    center, size = [float(middle[0]), 1.5, float(middle[2])], [40.0, 3.0, 40.0]
    center[axis], size[axis] = face + sign * 0.1, 0.2
    x, y, z = center
    wall = Box((x, y, z), (size[0], size[1], size[2]))
    return motion, Scene(primitives=[wall], floor=0.0)


def twice_as_fast(motion: Motion, draw: torch.Generator) -> Made | None:
    """Every other frame of one that walks, where a second or more is left."""
    if travel_speed(motion) < WALKS or motion.frames < 41:
        return None
    return Motion(motion.joints[::2]), FLOOR


def longer_bone(motion: Motion, draw: torch.Generator) -> Made:
    """One bone 10 cm longer, with all that hangs on it; on the floor again, as a longer leg lifts its body."""
    parent, joint = HUMANML3D.bones[int(torch.randint(len(HUMANML3D.bones), (), generator=draw))]
    moved = {joint}
    for above, below in HUMANML3D.bones:
        moved |= {below} if above in moved else set()
    along = torch.nn.functional.normalize(motion.joints[:, joint] - motion.joints[:, parent], dim=-1)
    joints = motion.joints.clone()
    joints[:, sorted(moved)] += 0.1 * along[:, None]
    joints[..., 1] += _bottom(motion.joints).min() - _bottom(joints).min()
    return replace(motion, joints=joints), FLOOR


def sliding(motion: Motion, draw: torch.Generator) -> Made:
    """All of it carried along at 0.3 m/s."""
    times = motion.times.double()
    return replace(motion, joints=motion.joints + 0.3 * times[:, None, None] * _way(draw)), FLOOR


def frozen(motion: Motion, draw: torch.Generator) -> Made | None:
    """A second's pause somewhere in one that walks, while it moves."""
    speeds = motion.joints[:, 0, ::2].diff(dim=0).norm(dim=-1) * motion.fps
    moving = (speeds > WALKS).nonzero().flatten()
    if travel_speed(motion) < WALKS or not len(moving):
        return None
    at = int(moving[int(torch.randint(len(moving), (), generator=draw))])
    count = round(motion.fps)
    held = motion.joints[at : at + 1].expand(count, -1, -1)
    return Motion(torch.cat([motion.joints[:at], held, motion.joints[at:]])), FLOOR


def teleported(motion: Motion, draw: torch.Generator) -> Made:
    """From some frame on 0.3 m further to some side."""
    at = 2 + int(torch.randint(motion.frames - 4, (), generator=draw))
    joints = motion.joints.clone()
    joints[at:] += 0.3 * _way(draw)
    return replace(motion, joints=joints), FLOOR


def tilted(motion: Motion, draw: torch.Generator) -> Made:
    """Each frame leaning by 20 degrees to one side about the place below the pelvis, and as high over the floor."""
    way, angle = _way(draw), math.radians(20)
    up = way.new_tensor([0.0, 1.0, 0.0])
    foot = motion.joints[:, :1] * way.new_tensor([1.0, 0.0, 1.0])
    joints = motion.joints - foot
    along, rise = (joints @ way)[..., None], (joints @ up)[..., None]
    joints = joints + (along * (math.cos(angle) - 1) + rise * math.sin(angle)) * way
    joints = joints + (rise * (math.cos(angle) - 1) - along * math.sin(angle)) * up + foot
    joints[..., 1] += (_bottom(motion.joints) - _bottom(joints))[:, None]
    return replace(motion, joints=joints), FLOOR


ABSURDITIES = {
    "lifted 5 cm": Absurdity(("unsupported_0.7s", "unsupported_3s"), lifted),
    "5 cm into a wall": Absurdity(("penetration",), into_wall),
    "twice the speed": Absurdity(("tempo", "speed", "joint_speed", "acceleration", "turning"), twice_as_fast),
    "a bone 10 cm longer": Absurdity(("proportions",), longer_bone),
    "sliding 0.3 m/s": Absurdity(("sliding_0.5s", "sliding_2s"), sliding),
    "frozen 1 s in a walk": Absurdity(("frozen",), frozen),
    "teleported 0.3 m": Absurdity(("jump",), teleported),
    "tilted 20 degrees": Absurdity(("balance",), tilted),
}
