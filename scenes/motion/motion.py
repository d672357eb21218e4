"""Motion as data: joint positions over time, in a world frame, and nothing else."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import IO, Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from scenes.archive import load_npz, npz_headers
from scenes.errors import UserError
from scenes.files import atomic_write, readable
from scenes.motion.branches import tree_of, turns
from scenes.motion.frames import HOME, Place, about_y, back, fine_enough, shifted
from scenes.motion.kinematics import local_rotations
from scenes.motion.rates import stride_of
from scenes.motion.skeleton import HUMANML3D, Skeleton, with_lengths
from scenes.motion.sound import check_places, check_rate, check_rotations, check_shapes, check_times, check_valid


@dataclass(frozen=True)
class Pose2D:
    """Where a person stands and looks: the rigid transform between a canonical and a world frame.

    A canonical motion starts with the pelvis over the origin, faces +z and has its floor at y = 0.

    Attributes:
        position: x, y, z of the floor point under the pelvis at the first frame, metres, world.
        heading: radians about +y; 0 faces +z, +pi/2 faces +x (the person's left at rest).
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    heading: float = 0.0

    def apply(self, points: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3"]:
        """Canonical to world, metres."""
        return points @ points.new_tensor(about_y(self.heading)).T + points.new_tensor(self.position)

    def invert(self, points: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3"]:
        """World to canonical, metres."""
        return (points - points.new_tensor(self.position)) @ points.new_tensor(about_y(self.heading))

    def moved(self, by: Place) -> Pose2D:
        """The same elsewhere, by so much (m)."""
        return Pose2D(shifted(self.position, by), self.heading)


@dataclass(frozen=True)
class Motion:
    """Joint positions over time.

    Attributes:
        joints: world positions, metres, ``[*b, T, J, 3]``, y up; in double precision where they are far from the origin
            (`scenes.motion.frames.FAR`).
        valid: True where a frame is real and not padding, ``[*b, T]``.
        fps: frames a second.
        t0: time of frame 0 on the task's clock, seconds.
        skeleton: names and tree of the J joints.
    """

    joints: Float[Tensor, "*b T J 3"]
    valid: Bool[Tensor, "*b T"] = None  # type: ignore[assignment]  # filled in __post_init__
    fps: float = 20.0
    t0: float = 0.0
    skeleton: Skeleton = field(default=HUMANML3D)

    def __post_init__(self) -> None:
        if self.joints.ndim < 3 or self.joints.shape[-2:] != (len(self.skeleton.names), 3):
            raise UserError(
                f"motion joints have shape {tuple(self.joints.shape)}, expected "
                f"[*b, T, {len(self.skeleton.names)}, 3] for this skeleton"
            )
        if self.valid is None:
            full = torch.ones(self.joints.shape[:-2], dtype=torch.bool, device=self.joints.device)
            object.__setattr__(self, "valid", full)

    @property
    def frames(self) -> int:
        """Number of frames T, padding included."""
        return int(self.joints.shape[-3])

    @property
    def seconds(self) -> float:
        """Duration T / fps, seconds."""
        return self.frames / self.fps

    @property
    def times(self) -> Float[Tensor, " T"]:
        """Time of every frame on the task's clock, seconds."""
        steps = torch.arange(self.frames, dtype=self.joints.dtype, device=self.joints.device)
        return self.t0 + steps / self.fps

    def joint(self, name: str) -> Float[Tensor, "*b T 3"]:
        """Positions of one joint, metres, world; raises UserError for an unknown name."""
        return self.joints[..., self.skeleton.index(name), :]

    def select(self, names: list[str] | tuple[str, ...]) -> Float[Tensor, "*b T n 3"]:
        """Positions of several joints, in the order given."""
        return self.joints[..., self.skeleton.indices(names), :]

    @cached_property
    def rotations(self) -> Float[Tensor, "*b T J 4"]:
        """Unit quaternions (w, x, y, z) of every joint against its parent in the T-pose, the root's in the world.

        With the skeleton's offsets and the root's positions they give rigid bodies' joints back; see
        `scenes.motion.kinematics`, which has the rule for what joints leave open.
        """
        return local_rotations(self)

    def frame_at(self, seconds: float) -> int:
        """Index of the frame nearest to a time on the task's clock; raises UserError outside it."""
        frame = round((seconds - self.t0) * self.fps)
        if frame == self.frames and seconds - self.t0 <= self.seconds + 1e-9:
            frame -= 1  # "at the end" means the last frame
        if not 0 <= frame < self.frames:
            end = self.t0 + self.seconds
            raise UserError(f"time {seconds:g} s lies outside the motion, which runs from {self.t0:g} to {end:g} s")
        return frame

    def placed(self, start: Pose2D) -> Motion:
        """The same motion moved from the canonical frame to the world."""
        return replace(self, joints=start.apply(self.joints))

    def moved(self, by: Place) -> Motion:
        """The same elsewhere, by so much (m), in double precision; unchanged where `by` is nothing."""
        if by == HOME:
            return self
        far = torch.tensor(by, dtype=torch.float64, device=self.joints.device)
        return replace(self, joints=self.joints.double() + far)

    def seen_from(self, origin: Place) -> Motion:
        """The same in the frame that begins at `origin` (m, world), in single precision; unchanged in the world's."""
        if origin == HOME:
            return self
        return replace(self, joints=self.moved(back(origin)).joints.float())

    def __getitem__(self, sample: int | slice | list[int] | Int[Tensor, " s"]) -> Motion:
        """One motion of a batch, or some of them as a batch."""
        return replace(self, joints=self.joints[sample], valid=self.valid[sample])

    def resampled(self, fps: float | int) -> Motion:
        """The same at another rate: frames left out where the rates allow, lines between frames otherwise.

        Bones are as long as the lines between their lengths say, and pelvis and chest keep their shape: what is rigid
        stays so.

        The first frame stays; the last is the last that the motion still reaches. Interpolated frames are real where
        both that they lie between are.
        """
        if stride := stride_of(self.fps, fps):
            return replace(self, joints=self.joints[..., ::stride, :, :], valid=self.valid[..., ::stride], fps=fps)
        last = (self.frames - 1) / self.fps
        at = torch.arange(int(last * fps + 1e-6) + 1, dtype=torch.float64) / fps * self.fps
        before = at.long().clamp(max=self.frames - 1)
        after, share = (before + 1).clamp(max=self.frames - 1), (at - before)[:, None, None].to(self.joints)
        joints = _between(self.joints[..., before, :, :], self.joints[..., after, :, :], share, self.skeleton)
        return replace(self, joints=joints, valid=self.valid[..., before] & self.valid[..., after], fps=fps)

    def save(self, path: str | Path, **extra: np.ndarray | float | int | str) -> None:
        """Write an .npz file, as `write` does; it is whole or absent."""
        with atomic_write(path) as file:
            self.write(file, **extra)

    def write(self, file: IO[bytes], **extra: np.ndarray | float | int | str) -> None:
        """Write `joints`, `rotations` and what else tells a motion (docs/formats.md), and `extra`, as an .npz.

        Joints are float32, or float64 where they are far from the origin (`scenes.motion.frames.fine_enough`).
        """
        arrays: dict[str, Any] = {
            "format": np.int64(FORMAT),
            "joints": fine_enough(self.joints.detach().cpu().numpy()),
            "rotations": self.rotations.detach().cpu().numpy().astype(np.float32),
            "valid": self.valid.cpu().numpy(),
            "fps": np.float64(self.fps),
            "t0": np.float64(self.t0),
            "joint_names": np.array(self.skeleton.names),
            "parents": np.array(self.skeleton.parents),
            "offsets": np.array(self.skeleton.offsets),
            "unit": np.array("m"),
            "up": np.array("y"),
            **{key: np.asarray(value) for key, value in extra.items()},
        }
        np.savez_compressed(file, **arrays)

    @classmethod
    def load(cls, path: str | Path) -> Motion:
        """Read a file that `save` wrote; raises UserError for anything else.

        `scenectl.data.formats.load_motion` reads what others write.
        """
        path = readable(path, "motion file")
        try:
            return cls.from_arrays(read_motion_arrays(path))
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise UserError(
                f"motion file '{path}' was not written by scenectl or is damaged ({reason}); save the motion again"
            ) from error

    @classmethod
    def from_arrays(cls, data: Mapping[str, Any]) -> Motion:
        """A motion of the arrays that `save` writes: the one place where motions from files are checked.

        Args:
            data: `joints` and `fps`; what else is left out is as `Motion` has it by default. Rotations are checked, and
                made anew of the joints.

        Raises:
            ValueError: what is wrong, to be carried on by the caller from "file 'x' ...".
        """
        if missing := [key for key in ("joints", "fps") if key not in data]:
            raise ValueError(f"it holds no '{missing[0]}'")
        arrays = {key: np.asarray(value) for key, value in data.items()}
        check_shapes({key: array.shape for key, array in arrays.items()})
        for key, kinds in _KINDS.items():
            if key in arrays and arrays[key].dtype.kind not in kinds:
                raise ValueError(f"its '{key}' are of type {arrays[key].dtype}, not {_WORDS[kinds]}")
        skeleton, joints = _skeleton(arrays), fine_enough(arrays["joints"])
        valid = arrays.get("valid", np.ones(joints.shape[:-2], bool)).astype(bool)
        fps, t0 = float(arrays["fps"].item()), float(arrays.get("t0", np.zeros(())).item())
        check_rate(fps, joints.shape[-3])
        check_times(t0)
        check_valid(valid)
        check_places(joints, skeleton.names)
        if rests(arrays):
            check_rotations(arrays)
        return cls(torch.from_numpy(joints), torch.from_numpy(valid), fps, t0, skeleton)


def _between(
    a: Float[Tensor, "*b T J 3"], b: Float[Tensor, "*b T J 3"], share: Float[Tensor, "T 1 1"], skeleton: Skeleton
) -> Float[Tensor, "*b T J 3"]:
    """Joints a share of the way from a to b: the root along a line, and so the directions and lengths of bones.

    Bones of a joint that branches turn as one, and the shape that they make goes from that in a to that in b.
    """
    tree, root = tree_of(skeleton), torch.lerp(a[..., :1, :], b[..., :1, :], share)
    first, last = (side[..., 1:, :] - side[..., tree.parents, :] for side in (a, b))
    bones = torch.lerp(first, last, share)
    lengths = torch.lerp(first.norm(dim=-1, keepdim=True), last.norm(dim=-1, keepdim=True), share)
    placed = bones * (lengths / bones.norm(dim=-1, keepdim=True).clamp_min(1e-9))
    for branch in tree.branches:
        own, before, after = (side[..., branch.bones, :] for side in (bones, first, last))
        shape = torch.lerp(before @ turns(before, branch), after @ turns(after, branch), share)
        placed[..., branch.bones, :] = shape @ turns(own, branch).mT
    joints = [root[..., 0, :]]
    for joint, parent in enumerate(tree.parents):
        joints.append(joints[parent] + placed[..., joint, :])
    return torch.stack(joints, dim=-2)


FORMAT = 2
"""Of motion files: since 2 they hold rotations, and offsets of the T-pose."""
_KINDS = {
    "joints": "fiu",
    "rotations": "fiu",
    "format": "iu",
    "valid": "biu",
    "fps": "fiu",
    "t0": "fiu",
    "joint_names": "US",
    "parents": "iu",
    "offsets": "fiu",
}
_WORDS = {"fiu": "numbers", "biu": "true or false", "US": "text", "iu": "whole numbers"}

MOST_BYTES = 2**29
"""Bytes that the arrays of a motion file may take: 256 motions of 60 s at 20 frames a second take 190 MB."""


def read_motion_arrays(path: str | Path, keys: Collection[str] = tuple(_KINDS)) -> dict[str, np.ndarray]:
    """Arrays of an .npz file, of those keys; raises ValueError and OSError as `scenes.archive.load_npz` does.

    Shapes are held against each other before any array is read. What others call a format, or rotations, isn't read.
    """
    headers = npz_headers(path)
    if "format" not in headers or headers["format"].dtype.kind not in _KINDS["format"]:
        keys = {*keys} - {"format", "rotations"}
    shapes = {key: header.shape for key, header in headers.items()}
    if "joints" in shapes:
        check_shapes({key: shape for key, shape in shapes.items() if key in _KINDS})
    return load_npz(path, keys, MOST_BYTES)


def rests(arrays: Mapping[str, np.ndarray]) -> bool:
    """Whether a file's offsets are those of a T-pose, and its rotations ours: from `FORMAT` on."""
    told = arrays.get("format", np.zeros((), int))
    return told.size == 1 and int(told.item()) >= FORMAT


def _skeleton(arrays: Mapping[str, np.ndarray]) -> Skeleton:
    """The skeleton of a file; the default where its names, if any, are that one's. Raises ValueError for another."""
    count = arrays["joints"].shape[-2]
    names = tuple(arrays["joint_names"].astype(str).tolist()) if "joint_names" in arrays else HUMANML3D.names
    if {"parents", "offsets"} <= arrays.keys():
        offsets = tuple((x, y, z) for x, y, z in arrays["offsets"].astype(float).tolist())
        stated = Skeleton(names, tuple(arrays["parents"].tolist()), offsets)
        if rests(arrays) or (stated.names, stated.parents) != (HUMANML3D.names, HUMANML3D.parents):
            return stated
        # Older files rest with hanging arms: of their offsets lengths count.
        same = np.allclose(stated.bone_lengths, HUMANML3D.bone_lengths, rtol=0, atol=1e-4)
        return HUMANML3D if same else with_lengths(HUMANML3D, stated.bone_lengths)
    if count != len(HUMANML3D.names) or names != HUMANML3D.names:
        raise ValueError(f"it has {count} joints of a skeleton that it does not describe by 'parents' and 'offsets'")
    return HUMANML3D
