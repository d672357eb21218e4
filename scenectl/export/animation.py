"""Motions as animation tools have them: how the joints of a skeleton turn over time, and where its root is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, Slerp

from scenes.errors import UserError
from scenes.mesh.scale import TO_Y_UP
from scenes.motion.fitting import fitted
from scenes.motion.kinematics import forward
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid
from scenes.motion.rotations import steady
from scenes.motion.skeleton import FEET, HUMANML3D, Skeleton
from scenes.motion.sound import check_rate

RIGID = 1e-4
"""Metres by which joints may be off their skeleton's pieces and count as rigid: what a round trip keeps."""


@dataclass(frozen=True, eq=False)
class Animation:
    """One motion of one skeleton, every frame of it real.

    Attributes:
        name: what tools list it under.
        skeleton: names, tree, and offsets (m) in the T-pose, y up, facing +z.
        rotations: unit quaternions (w, x, y, z) of every joint against its parent in the T-pose, the root's against the
            world, without changes of sign, ``[T, J, 4]`` float64.
        roots: places of the root, world metres, ``[T, 3]`` float64.
        fps: frames a second.
        ours: where HumanML3D's 22 joints are among the skeleton's, ``[22]``.
        hips: places (m) of joint 1 against joint 0, ``[T, 3]``, where the root is no part of the body but a mark that
            carries it, on the floor or at the origin; None where all joints but the root keep their offsets.
    """

    name: str
    skeleton: Skeleton
    rotations: Float[np.ndarray, "T J 4"]
    roots: Float[np.ndarray, "T 3"]
    fps: float
    ours: Int[np.ndarray, "22"]
    hips: Float[np.ndarray, "T 3"] | None = None

    @classmethod
    def of(cls, motion: Motion, name: str = "motion") -> tuple[Animation, float]:
        """The animation of one motion ``[T, 22, 3]``, and by how much (m) that moved the joint that it moved most.

        What is rigid stays where it is, to `RIGID`, and the number is 0. For what is not, a skeleton is fitted
        (`scenes.motion.fitting`) and the motion put on its bones.

        Raises:
            UserError: a batch instead of one motion, or no valid frame.
        """
        if motion.joints.ndim != 3:
            raise UserError(f"an animation is one motion, not {tuple(motion.joints.shape[:-3])}; choose one of them")
        joints = motion.joints.detach()[motion.valid].double().cpu()
        if len(joints) == 0:
            raise UserError("a motion without a valid frame cannot be exported; export another")
        motion, moved = _on_bones(Motion(joints, fps=motion.fps, skeleton=motion.skeleton))
        roots, ours = motion.joints[:, 0].numpy(), np.arange(len(motion.skeleton.names))
        return cls(name, motion.skeleton, motion.rotations.numpy(), roots, motion.fps, ours), moved

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.roots)

    @property
    def times(self) -> Float[np.ndarray, " T"]:
        """Time of every frame, seconds from the first."""
        return np.arange(self.frames) / self.fps

    @cached_property
    def size(self) -> float:
        """How many times as long its legs are as HumanML3D's, by its T-pose with y up."""
        rest = np.zeros((len(self.skeleton.names), 3))
        for parent, joint in self.skeleton.bones:
            rest[joint] = rest[parent] + self.skeleton.offsets[joint]
        pelvis, *feet = rest[self.ours[HUMANML3D.indices(("pelvis", *FEET))], 1]
        return float((pelvis - np.mean(feet)) / HUMANML3D.legs)

    @cached_property
    def translations(self) -> Float[np.ndarray, "T J 3"]:
        """Places of every joint against its parent, the root's in the world, metres; constant but for root and hips."""
        places = np.tile(np.array(self.skeleton.offsets), (self.frames, 1, 1))
        places[:, 0] = self.roots
        if self.hips is not None:
            places[:, 1] = self.hips
        return places

    @cached_property
    def joints(self) -> Float[np.ndarray, "T J 3"]:
        """World positions of all joints, metres."""
        joints = forward(torch.from_numpy(self.rotations), torch.from_numpy(self.roots), self.skeleton).numpy()
        if self.hips is not None:
            joints[:, 1:] += _scipy(self.rotations[:, 0]).apply(self.hips - self.skeleton.offsets[1])[:, None]
        return joints

    @cached_property
    def orientations(self) -> Float[np.ndarray, "T J 4"]:
        """Unit quaternions (w, x, y, z) of all joints against the T-pose in the world."""
        turns = [_scipy(self.rotations[:, 0])]
        for joint, parent in enumerate(self.skeleton.parents[1:], 1):
            turns.append(turns[parent] * _scipy(self.rotations[:, joint]))
        return _steady(turns)

    def resampled(self, fps: float | int) -> Animation:
        """The same at another rate: rotations by slerp, roots by a cubic spline; the last frame still reached is last.

        Bones are as long as before at any rate.

        Raises:
            UserError: a rate that nobody records at.
        """
        try:
            check_rate(fps, self.frames)
        except ValueError as error:
            raise UserError(f"{fps:g} frames a second cannot be written: {error}") from error
        if fps == self.fps or self.frames < 2:
            return replace(self, fps=float(fps))
        at = np.arange(int(self.times[-1] * fps + 1e-6) + 1) / fps
        at = np.minimum(at, self.times[-1])
        turns = [Slerp(self.times, _scipy(self.rotations[:, joint]))(at) for joint in range(self.rotations.shape[1])]
        roots, hips = CubicSpline(self.times, self.roots)(at), None
        if self.hips is not None:
            hips = CubicSpline(self.times, self.hips)(at)
        return replace(self, rotations=_steady(turns), roots=roots, hips=hips, fps=float(fps))

    def in_place(self) -> Animation:
        """The same without root motion: the root stays over the place of its first frame, and rises and sinks."""
        roots, hips = self.roots.copy(), None if self.hips is None else self.hips.copy()
        for line in (roots, hips):
            if line is not None:
                line[:, [0, 2]] = line[0, [0, 2]]
        return replace(self, roots=roots, hips=hips)

    def turned(self, up: str) -> Animation:
        """The same in a world in which another axis is up (a key of `TO_Y_UP`), and the T-pose stands along it, too.

        With "z" a T-pose faces -y, as Blender has it, and x stays the left.
        """
        across = Rotation.from_matrix(TO_Y_UP[up].T)
        x, y, z = across.apply(np.array(self.skeleton.offsets)).T.tolist()
        turns = [across * _scipy(self.rotations[:, joint]) * across.inv() for joint in range(len(self.skeleton.names))]
        return replace(
            self,
            skeleton=replace(self.skeleton, offsets=tuple(zip(x, y, z, strict=True))),
            rotations=_steady(turns),
            roots=across.apply(self.roots),
            hips=None if self.hips is None else across.apply(self.hips),
        )


def _scipy(rotations: Float[np.ndarray, "T 4"]) -> Rotation:
    return Rotation.from_quat(rotations, scalar_first=True)


def _steady(turns: Sequence[Rotation]) -> Float[np.ndarray, "T J 4"]:
    """Quaternions (w, x, y, z) of each joint's rotations, without changes of sign."""
    quaternions: np.ndarray = np.stack([turn.as_quat(scalar_first=True) for turn in turns], axis=1)
    return steady(torch.from_numpy(quaternions)).numpy()


def _on_bones(motion: Motion) -> tuple[Motion, float]:
    """The motion with rigid pieces, and by how much (m) it moved for that."""
    on = rigid(motion)
    if float((on.joints - motion.joints).norm(dim=-1).max()) <= RIGID:
        return motion, 0.0
    on = rigid(motion, fitted(motion))
    moved = float((on.joints - motion.joints).norm(dim=-1).max())
    return on, moved if moved > RIGID else 0.0
