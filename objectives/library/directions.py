"""Directions: which way a body faces, where its bones point, and how its joints are turned."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Literal

import torch
from jaxtyping import Bool, Float
from pydantic import Field
from torch import Tensor

from objectives.aims import Aim
from objectives.context import Context
from objectives.maths import angle_between, beyond, length, softened
from objectives.parameters import FloorPoint, Point, check_heading
from objectives.registry import Masked, goal
from objectives.tracks import Track, TrackBase
from scenes.errors import UserError
from scenes.motion.bones import rest_pose
from scenes.motion.branches import tree_of
from scenes.motion.headings import rotation_about_y
from scenes.motion.kinematics import HINGES, orientations
from scenes.motion.motion import Motion
from scenes.motion.rotations import about, matrices, rotated, unit_quaternions
from scenes.motion.skeleton import Skeleton

Part = Literal["pelvis", "chest", "head"]
"""Parts of a body that have a front."""
PARTS = {"pelvis": "pelvis", "chest": "spine3", "head": "head"}
"""Joints whose rotations turn them."""
Cone = Annotated[float, Field(ge=0, lt=180)]
"""Degrees around a direction."""
Vector = tuple[float, float, float]

NEAR = 0.1
"""Metres within which a place lies in no direction from a joint, and length within which a front has no heading."""
_SHORTEST = 0.01
"""Metres: two joints nearer than that point nowhere."""
_OFF_HINGE = 30.0
"""Degrees by which a hinge may turn beside its axis: a limb that is nearly straight is told by that much at most."""
_UNIT = 0.01
"""By how much a quaternion's length may differ from 1, as it does in numbers of three digits."""


# The scale is 1 / (2 s^2) as that of `joint_target`, with a standard deviation of 5 degrees: 5 cm at arm's length.
@goal(unit="deg", kernel="squared", reduction="sum", scale=0.02, tolerance=2.0, pulls=True, local=True)
def face(
    motion: Motion,
    context: Context,
    *,
    part: Part = "pelvis",
    position: Point | FloorPoint | None = None,
    track: Track | None = None,
    heading: float | None = None,
    direction: Vector | None = None,
    within: Cone = 0.0,
    level: bool = True,
) -> Masked:
    """Turn the pelvis, the chest or the head towards a place, a moving place or a direction.

    Residual: the angle (deg) between the part's front and the direction, beyond `within`. A front is the z axis of the
    part's rotation: the pelvis's by hips and spine, the chest's by neck and collars. Of the head, 22 joints tell how
    the neck leans and nothing of its face: its front is the chest's, carried by the neck on the shortest way. A head
    that is turned over still shoulders is not seen.

    A place within 0.1 m of the part lies in no direction, and is not faced. The gradient vanishes nowhere else, also
    not for a place right behind.

    Args:
        part: "pelvis", "chest" or "head".
        position: what to face, world m; [x, z] for a place on the floor.
        track: what to face as a function of time, over the track's span.
        heading: which way to face, rad about +y: 0 is +z, pi/2 is +x.
        direction: the same as a vector of any length, world.
        within: half the angle of the cone around the direction that is as good, deg.
        level: heading alone counts. Otherwise the lean of the part does, too.

    Raises:
        UserError: none or several of position, track, heading and direction, or one that has no heading.
    """
    if isinstance(position, FloorPoint) and not level:
        raise UserError("'position' is [x, z] and so has no height to look at; give [x, y, z], or level = true")
    origin = motion.joint(PARTS[part])
    wanted, active = _wanted(origin, motion, position, track, heading, direction)
    front = _turned(motion, PARTS[part])[..., 0, :, 2]
    if level:
        if direction is not None and math.hypot(direction[0], direction[2]) < 1e-3 * math.hypot(*direction):
            raise UserError(f"'direction' {list(direction)} is vertical and has no heading; give level = false")
        ground = origin.new_tensor([1.0, 0.0, 1.0])
        front, wanted = front * ground, wanted * ground
    missing = (angle_between(front, wanted, NEAR, NEAR).rad2deg() - within).clamp_min(0)
    aim = _unit(wanted)
    aim = aim + aim.new_tensor([0.0, math.nan if level else 0.0, 0.0])
    return Masked(
        missing[..., None], active, labels=[part], joints=[PARTS[part]], points=origin[..., None, :],
        aim=Aim("front", aim[..., None, :]),
    )  # fmt: skip


@goal(unit="deg", kernel="squared", reduction="sum", scale=0.02, tolerance=2.0, pulls=True, local=True)
def bone_direction(
    motion: Motion,
    context: Context,
    *,
    bone: str | list[str],
    direction: Vector | None = None,
    position: Point | None = None,
    track: Track | None = None,
    frame: Literal["world", "pelvis", "chest"] = "world",
    within: Cone = 0.0,
) -> Masked:
    """Point a bone, or a limb from one joint to another, in a direction or at a place.

    Residual: the angle (deg) between the bone and the direction, beyond `within`.

    Args:
        bone: the joint in which the bone ends, such as "left_wrist" for the forearm; or two joints, from the first to
            the second, such as ["right_shoulder", "right_wrist"] for a whole arm.
        direction: a vector of any length, in the frame.
        position: a place at which it points instead, world m, as seen from the joint where it begins.
        track: such a place as a function of time, over the track's span.
        frame: of the direction: the world's, or that of the pelvis or chest: x is the person's left, y up, z forward.
        within: half the angle of the cone around the direction that is as good, deg.

    Raises:
        UserError: none or several of direction, position and track, a frame for a place, a joint that ends no bone, or
            a bone that is rigid in its frame.
    """
    first, second = _ends(bone, motion.skeleton)
    origin, end = motion.joint(first), motion.joint(second)
    if frame != "world" and direction is None:
        raise UserError(f"frame '{frame}' is for a 'direction'; places are the world's")
    wanted, active = _wanted(origin, motion, position, track, None, direction, "position, track and direction")
    if frame != "world":
        _check_piece(first, second, PARTS[frame], motion.skeleton)
        wanted = rotated(_turned(motion, PARTS[frame])[..., 0, :, :], wanted)
    angle = angle_between(end - origin, wanted, _SHORTEST, NEAR).rad2deg()
    whole = motion.skeleton.parents[motion.skeleton.index(second)] == motion.skeleton.index(first)
    return Masked(
        (angle - within).clamp_min(0)[..., None], active, labels=[second if whole else f"{first} to {second}"],
        joints=[second if whole else None], points=origin[..., None, :], aim=Aim("bone", _unit(wanted)[..., None, :]),
    )  # fmt: skip


@goal(unit="deg", kernel="squared", reduction="sum", scale=0.02, dim=3, tolerance=2.0, pulls=True)
def joint_rotation(
    motion: Motion,
    context: Context,
    *,
    joint: str,
    quaternion: tuple[float, float, float, float] | None = None,
    euler: Vector | None = None,
    frame: Literal["parent", "world"] = "parent",
    within: Cone = 0.0,
) -> Masked:
    """Turn a joint, with what hangs on it, as stated.

    Residual: the rotation vector (deg) that is missing, beyond `within`. Rotations are against the T-pose (+z forward,
    y up, arms to the sides), by the rule of `scenes.motion.kinematics`. 22 joints tell where bones point, and turns
    about a bone only of pelvis and chest. Hips and shoulders turn about theirs so that knees and elbows bend as hinges:
    these turn about one axis of their parents, knees about x, the left elbow about -y and the right one about y. The
    spine shares the turn from pelvis to chest, so ask the chest (spine3) against the world. Other joints turn about no
    bone of their own. Wrists, toes and the head end limbs and can't be asked.

    Args:
        joint: its name.
        quaternion: [w, x, y, z], of length 1.
        euler: [x, y, z] degrees instead: turned about z, then x, then y, all of them fixed axes.
        frame: "parent" for the rotation against the joint above, "world" for that against the world.
        within: angle that is as good, deg.

    Raises:
        UserError: neither or both of quaternion and euler, a quaternion that is none, a joint that has no bone, or a
            hinge that shall turn about another axis than its own.
    """
    index, skeleton = motion.skeleton.index(joint), motion.skeleton
    if index not in skeleton.parents:
        able = ", ".join(name for j, name in enumerate(skeleton.names) if j in skeleton.parents)
        raise UserError(f"'{joint}' ends a limb, so no joint tells how it is turned; joints that can be asked: {able}")
    above = skeleton.names[max(skeleton.parents[index], 0)]
    (turned, over), stated = _turned(motion, joint, above).unbind(-3), _rotation(quaternion, euler)
    wanted = motion.joints.new_tensor(stated.tolist()).expand(turned.shape)
    if frame == "parent" and index:
        _check_hinge(joint, stated)
        wanted = over @ wanted
    missing = beyond(_rotation_vector(turned @ wanted.mT).rad2deg(), within)
    aim = Aim("rotation", unit_quaternions(wanted.detach())[..., None, :])
    return Masked(missing, labels=[joint], points=motion.joint(joint)[..., None, :], aim=aim)


def _turned(motion: Motion, *joints: str) -> Float[Tensor, "*b T n 3 3"]:
    """Rotations of joints; of a person at rest in padding, where joints that coincide have none."""
    rest = rest_pose(motion.skeleton).to(motion.joints)
    still = replace(motion, joints=torch.where(motion.valid[..., None, None], motion.joints, rest))
    return orientations(still, joints)


def _wanted(
    origin: Float[Tensor, "*b T 3"],
    motion: Motion,
    position: Point | FloorPoint | None,
    track: TrackBase | None,
    heading: float | None,
    direction: Vector | None,
    among: str = "position, track, heading and direction",
) -> tuple[Float[Tensor, "*b T 3"], Bool[Tensor, " T"] | None]:
    """Where to point from an origin, as vectors of any length, and the frames at which it is stated."""
    stated = [value for value in (position, track, heading, direction) if value is not None]
    if len(stated) != 1:
        raise UserError(f"needs one of {among}, not {len(stated) or 'none'}")
    if track is not None:
        if track.columns != 1:
            raise UserError(f"the track has {track.columns} columns; name a track of one place")
        return track.position(motion.times)[:, 0] - origin, track.active(motion.times)[:, 0]
    if isinstance(position, Point):
        return origin.new_tensor(position) - origin, None
    if isinstance(position, FloorPoint):
        place = origin.new_tensor([position.x, 0.0, position.z])
        return (place - origin) * origin.new_tensor([1.0, 0.0, 1.0]), None
    if heading is not None:
        check_heading(heading)
        return rotation_about_y(origin.new_tensor(heading))[:, 2].expand(origin.shape), None
    assert direction is not None
    if not any(direction):
        raise UserError(f"'direction' {list(direction)} has no length and so points nowhere")
    size = math.hypot(*direction)
    return origin.new_tensor([value / size for value in direction]).expand(origin.shape), None


def _unit(vectors: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3"]:
    """Directions, nan where there is hardly one."""
    unit, size = softened(vectors.detach(), NEAR)
    return torch.where((size < 1)[..., None], math.nan, unit)


def _ends(bone: str | list[str], skeleton: Skeleton) -> tuple[str, str]:
    """The joints where a bone or limb begins and ends."""
    if isinstance(bone, str):
        above = skeleton.parents[skeleton.index(bone)]
        if above < 0:
            raise UserError(f"no bone ends in '{bone}'; name the joint at the far end of one, or two joints")
        return skeleton.names[above], bone
    if len(bone) != 2 or bone[0] == bone[1]:
        raise UserError(f"'bone' is a joint or two different joints, not {bone}")
    skeleton.indices(bone)
    return bone[0], bone[1]


def _check_piece(first: str, second: str, part: str, skeleton: Skeleton) -> None:
    """Raise UserError for a bone that is one rigid piece with the part in whose frame it is asked for."""
    joint = skeleton.index(part)
    piece = {
        joint,
        *(bone + 1 for branch in tree_of(skeleton).branches if branch.joint == joint for bone in branch.bones),
    }
    if piece.issuperset(skeleton.indices([first, second])):
        raise UserError(
            f"the bone from '{first}' to '{second}' is one rigid piece with '{part}' and points one way in its frame; "
            "ask in the world, or for another bone"
        )


def _rotation(quaternion: tuple[float, float, float, float] | None, euler: Vector | None) -> Float[Tensor, "3 3"]:
    if (quaternion is None) == (euler is None):
        raise UserError("needs either 'quaternion' or 'euler'")
    if quaternion is not None:
        size = math.hypot(*quaternion)
        if abs(size - 1) > _UNIT:
            raise UserError(f"'quaternion' {list(quaternion)} has a length of {size:.3g}; give w, x, y, z of length 1")
        return matrices(torch.tensor(quaternion, dtype=torch.float64) / size)
    x, y, z = (about(axis, angle) for axis, angle in enumerate(torch.tensor(euler, dtype=torch.float64).deg2rad()))
    return y @ x @ z


def _check_hinge(joint: str, rotation: Float[Tensor, "3 3"]) -> None:
    axis = next((axis for hinge, _, axis in HINGES.values() if hinge == joint), None)
    if axis is None:
        return
    along = torch.tensor(axis, dtype=torch.float64)
    turn = _rotation_vector(rotation).rad2deg()
    bend = float(turn @ along)
    aside = float(length(turn - bend * along))
    shown = next(("" if value > 0 else "-") + "xyz"[k] for k, value in enumerate(axis) if value)
    hinge = f"'{joint}' is a hinge that bends about {shown} of its parent alone"
    if aside > _OFF_HINGE:
        raise UserError(
            f"{hinge}, and shall turn {aside:.0f} degrees about other axes; turn the joint above it, or use "
            "bone_direction"
        )
    if bend < -_OFF_HINGE:
        raise UserError(f"{hinge}, and shall bend {-bend:.0f} degrees the wrong way; change the sign of its angle")


def _rotation_vector(rotations: Float[Tensor, "*b 3 3"]) -> Float[Tensor, "*b 3"]:
    """Axes times angles (rad, at most pi) of rotations; smooth but where it jumps from one half turn to the other."""
    found = unit_quaternions(rotations)
    found = torch.where(found[..., :1] < 0, -found, found)
    sine = length(found[..., 1:])
    angle = 2 * torch.atan2(sine, found[..., 0])
    small = sine < 1e-6
    factor = torch.where(small, 2.0, angle / torch.where(small, 1.0, sine))
    return found[..., 1:] * factor[..., None]
