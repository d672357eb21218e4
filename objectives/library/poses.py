"""Whole poses: a body at moments as in a recording, or all along one.

What was recorded is put on the bones of the body in question (`scenes.motion.rigid`), raised or lowered so that its
lower foot is as high as it was. It is asked for in the world, or relative to the pelvis: then the pelvis's place and
heading are free, and its tilt counts, as gravity makes a bow another pose than a lying body.
"""

from __future__ import annotations

import math
from typing import Literal

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from objectives.clips import Clip, Poses
from objectives.context import Context
from objectives.library._joints import Joints, chosen
from objectives.library.alignment import aligned
from objectives.marks import Mark
from objectives.maths import beyond, keyed, pelvis_heading
from objectives.parameters import FloorPoint, NotNegative, Positive, Time, check_heading
from objectives.registry import Masked, goal
from scenes.errors import UserError
from scenes.motion.bones import rest_pose
from scenes.motion.headings import turned, turned_by
from scenes.motion.motion import Motion
from scenes.motion.rigid import on_bones
from scenes.motion.skeleton import FEET, HUMANML3D

Frame = Literal["pelvis", "world"]

_FIGURES = 5
"""Bodies at most that show a pose that is held, or a clip."""
_LIMB = 0.025
"""Radius (m) of their limbs: thinner than any real one, so that they show the body that is in them."""
_GROUND = 0.05
"""Metres by which a surface must be nearer than the ground to be another one: feet stand about so high over it."""


# Scales are joint_target's (there with the reason): one joint of one frame pulls as one target does.
@goal(unit="m", kernel="squared", reduction="sum", scale=200.0, dim=3, tolerance=0.01, pulls=True)
def pose(
    motion: Motion,
    context: Context,
    *,
    pose: Poses,
    joints: Joints | None = None,
    frame: Frame = "pelvis",
    at: list[float] | None = None,
    within: NotNegative = 0.0,
) -> Masked:
    """Bring the body, or some of its joints, into a recorded pose, or into several in turn.

    Its residual is x - target of each joint, m, shortened by `within`. Relative to the pelvis, targets are carried by
    it: by its place and by the turn about the vertical that brings the recorded hips and spine nearest to its own.

    Args:
        pose: the file and time it is taken from, such as "clip.bvh#2.4"; in Python also [22, 3], world m, or a Motion
            of one frame. Several, one for each time of `at`.
        joints: which of them count; by default all.
        frame: "pelvis" leaves its place and heading free; "world" asks for the recorded places.
        at: times in seconds; without them one pose holds at every frame.
        within: how far joints may be, m.

    Raises:
        UserError: no pose, numbers of poses and times that do not match, or no joint but the pelvis relative to itself.
    """
    poses = pose if isinstance(pose, list) else [pose]
    if not poses:
        raise UserError("'pose' is an empty list; state a pose, such as \"clip.bvh#2.4\"")
    bodies = _on_bones(torch.stack([torch.from_numpy(p.joints) for p in poses]).to(motion.joints), motion)
    if at is None:
        if len(poses) != 1:
            raise UserError(f"{len(poses)} poses need as many times in 'at'")
        wanted, active = bodies.expand(motion.frames, -1, -1), motion.valid
    else:
        if len(poses) not in (1, len(at)):
            raise UserError(f"{len(poses)} poses need as many times in 'at', not {len(at)}")
        wanted, active = keyed(bodies.expand(len(at), -1, -1), at, motion)
    relative = torch.full_like(active, frame == "pelvis")
    return _asked(motion, wanted, active, relative, joints, frame, within, still=True)


@goal(unit="m", kernel="squared", reduction="sum", scale=200.0, dim=3, tolerance=0.02, pulls=True)
def like(
    motion: Motion,
    context: Context,
    *,
    clip: Clip,
    joints: Joints | None = None,
    frame: Frame = "pelvis",
    timing: Literal["clip", "free"] = "clip",
    begin: Time = 0.0,
    end: Time | None = None,
    within: NotNegative = 0.0,
    position: FloorPoint | None = None,
    heading: float | None = None,
    clear: Positive | None = None,
) -> Masked:
    """Move as a recording does, in its own time or in any that keeps its order.

    The residual is that of `pose` at every frame. In the clip's time, frames after its end are free, and what of it is
    after `end` is not asked for. With free timing all of the clip happens between `begin` and `end`, at half to twice
    its speed at every moment: by the alignment of least squares (dynamic time warping, Sakoe and Chiba 1978, with
    slopes of 1/2 to 2), found anew for each motion; its gradient is that at the best alignment.

    Args:
        clip: the recording's file, such as "clip.bvh", or "clip.bvh#1.5:4" for what it has between these times; in
            Python also a Motion.
        joints: which of them count; by default all.
        frame: "pelvis" leaves its place and heading free; "world" asks for the recorded places.
        timing: "clip" keeps the recording's, "free" leaves it to the motion.
        begin: when the clip begins, s.
        end: when it ends at the latest, s; by default with the motion.
        within: how far joints may be, m.
        position: where the pelvis is at its first frame, [x, z] world m; by default where it was recorded.
        heading: how the body faces there, rad about +y, 0 being +z; by default as recorded.
        clear: where the recorded body would come nearer than this (m) to anything but the ground, the clip holds
            relative to the pelvis, so that the body can get out of the way.

    Raises:
        UserError: a clip too long or too short for its time, `clear`, `position` or `heading` relative to the pelvis,
            or no joint but the pelvis relative to itself.
    """
    stated = {"position": position, "heading": heading, "clear": clear}
    if frame == "pelvis" and (idle := [key for key, value in stated.items() if value is not None]):
        raise UserError(f"'{idle[0]}' says something in the world; add frame = \"world\"")
    if heading is not None:
        check_heading(heading)
    slack = 1e-3 / motion.fps
    times = motion.times - begin
    active = (times >= -slack) & ((times <= clip.seconds + slack) | (timing == "free"))
    if end is not None:
        active = active & (motion.times <= end + slack)
    active = active & motion.valid

    def at(seconds: Float[Tensor, " N"]) -> Float[Tensor, "N J 3"]:
        return _placed(_on_bones(clip.at(seconds), motion), _on_bones(clip.at(seconds[:0].new_zeros(1)), motion)[0],
                       position, heading)  # fmt: skip

    if timing == "clip":
        wanted = at(times)
    else:
        wanted = aligned(motion, active, at, clip.seconds, _named(joints, motion, frame), frame == "pelvis")
    relative = torch.full_like(active, frame == "pelvis")
    if clear is not None:
        relative = relative | _crowded(wanted, motion, context, clear)
    return _asked(motion, wanted, active, relative, joints, frame, within, still=False)


def _asked(
    motion: Motion,
    wanted: Float[Tensor, "*w T J 3"],
    active: Bool[Tensor, "*b T"],
    relative: Bool[Tensor, "*b T"],
    joints: Joints | None,
    frame: Frame,
    within: float,
    still: bool,
) -> Masked:
    """Joints where a body has them (m, world), or relative to the pelvis."""
    names = _named(joints, motion, frame)
    bodies = torch.where(relative[..., None, None], carried(wanted, motion), wanted)
    some = motion.skeleton.indices(names)
    points, target = motion.joints[..., some, :], bodies[..., some, :]
    offset = points - target
    counts = active[..., None] & ~(relative[..., None] & (torch.tensor(some, device=active.device) == 0))
    drawn = None if frame == "pelvis" else target.masked_fill(relative[..., None, None], math.nan)

    def marks() -> list[Mark]:
        return _figures(bodies.detach(), active, motion, names, still)

    return Masked(
        (beyond(offset, within) if within else offset).flatten(-2), counts, sizes=3, labels=names, points=points,
        targets=drawn, marks=marks,
    )  # fmt: skip


def _named(joints: Joints | None, motion: Motion, frame: Frame) -> list[str]:
    """The joints that count; relative to the pelvis, that itself says nothing."""
    root = motion.skeleton.names[0]
    names = [name for name in chosen(joints, motion) if frame == "world" or name != root]
    if not names:
        raise UserError(f'{root} relative to itself says nothing; name other joints, or say frame = "world"')
    return names


def _on_bones(joints: Float[Tensor, "*b 22 3"], motion: Motion) -> Float[Tensor, "*b 22 3"]:
    """Recorded bodies on the motion's bones, with the lower foot as high as it was."""
    skeleton = motion.skeleton
    if skeleton.names != HUMANML3D.names:
        raise UserError("a recorded pose has HumanML3D's joints, and the motion has others")
    there, feet = on_bones(joints, skeleton), skeleton.indices(FEET)
    lift = joints[..., feet, 1].amin(-1) - there[..., feet, 1].amin(-1)
    return there + torch.stack([torch.zeros_like(lift), lift, torch.zeros_like(lift)], dim=-1)[..., None, :]


def carried(bodies: Float[Tensor, "*w T J 3"], motion: Motion) -> Float[Tensor, "*b T J 3"]:
    """Bodies (m) moved and turned about the vertical so that each has the pelvis of the motion's."""
    root = motion.joints[..., :1, :]
    turn = pelvis_heading(bodies, motion.joints, motion.skeleton)[..., None, :]
    return root + turned_by(bodies - bodies[..., :1, :], *turn.unbind(-1))


def _placed(
    bodies: Float[Tensor, "N J 3"], first: Float[Tensor, "J 3"], position: FloorPoint | None, heading: float | None
) -> Float[Tensor, "N J 3"]:
    """Bodies (m) moved so that the first has its pelvis over a place and faces somewhere."""
    root = first[0] * first.new_tensor([1.0, 0.0, 1.0])
    there = root if position is None else root.new_tensor([position.x, 0.0, position.z])
    if heading is None:
        return bodies - root + there
    facing = pelvis_heading(first, rest_pose(HUMANML3D).to(first), HUMANML3D)
    return turned(turned_by(bodies - root, *facing.unbind(-1)), first.new_tensor(heading)) + there


@torch.no_grad()
def _crowded(bodies: Float[Tensor, "*b T J 3"], motion: Motion, context: Context, clear: float) -> Bool[Tensor, "*b T"]:
    """Frames at which bodies come nearer than so many metres to anything but the ground."""
    times = motion.times[:, None].expand(bodies.shape[:-1])
    distance, ground = context.scene.distance(bodies, times), context.ground_under(bodies)
    near = distance < clear
    if ground is not None:
        near &= distance < bodies[..., 1] - ground - _GROUND
    return near.any(-1)


def _figures(
    bodies: Float[Tensor, "T J 3"], active: Bool[Tensor, " T"], motion: Motion, names: list[str], still: bool
) -> list[Mark]:
    """Bodies at the frames that are asked for: of a few of them where they are many, or moving."""
    frames = active.nonzero()[:, 0]
    if len(frames) > _FIGURES and still:
        frames = frames[torch.linspace(0, len(frames) - 1, _FIGURES).round().long()]
    if not len(frames):
        return []
    here = set(motion.skeleton.indices(names))
    limbs = [(a, b) for a, b in motion.skeleton.bones if b in here and (a in here or a == 0)]
    ends = {joint for limb in limbs for joint in limb}
    sets = [("capsule", limb) for limb in limbs] + [("ball", (joint,)) for joint in sorted(here - ends)]
    if still:
        return [Mark(shape, bodies[f][list(of)], _LIMB) for f in frames.tolist() for shape, of in sets]  # type: ignore[arg-type]
    times = motion.times[frames]
    return [Mark(shape, bodies[frames][:, list(of)], _LIMB, times=times) for shape, of in sets]  # type: ignore[arg-type]
