"""Motion as data: joint positions over time, in a world frame, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from scenes.errors import UserError
from scenes.files import atomic_write, read_arrays
from scenes.motion.frames import HOME, Place, about_y, back, fine_enough, shifted
from scenes.motion.skeleton import HUMANML3D, Skeleton


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

    def __getitem__(self, sample: int) -> Motion:
        """One motion of a batch."""
        return replace(self, joints=self.joints[sample], valid=self.valid[sample])

    def save(self, path: str | Path, **extra: np.ndarray | float | int | str) -> None:
        """Write an .npz file, as `write` does; it is whole or absent."""
        with atomic_write(path) as file:
            self.write(file, **extra)

    def write(self, file: IO[bytes], **extra: np.ndarray | float | int | str) -> None:
        """Write `joints`, `valid`, `fps`, `t0`, joint names and parents, and `extra`, as an .npz archive.

        Joints are float32, or float64 where they are far from the origin (`scenes.motion.frames.fine_enough`).
        """
        arrays: dict[str, Any] = {
            "joints": fine_enough(self.joints.detach().cpu().numpy()),
            "valid": self.valid.cpu().numpy(),
            "fps": np.float64(self.fps),
            "t0": np.float64(self.t0),
            "joint_names": np.array(self.skeleton.names),
            "parents": np.array(self.skeleton.parents),
            "offsets": np.array(self.skeleton.offsets),
            **{key: np.asarray(value) for key, value in extra.items()},
        }
        np.savez_compressed(file, **arrays)

    @classmethod
    def load(cls, path: str | Path) -> Motion:
        """Read a file that `save` wrote; raises UserError for anything else."""
        return read_arrays(path, "motion file", cls._from_arrays, "save the motion again")

    @classmethod
    def _from_arrays(cls, data: Any) -> Motion:
        """What `save` wrote; raises ValueError or UserError where it is unsound."""
        skeleton = Skeleton(
            tuple(str(name) for name in data["joint_names"]),
            tuple(int(parent) for parent in data["parents"]),
            tuple((float(o[0]), float(o[1]), float(o[2])) for o in data["offsets"]),
        )
        joints = torch.from_numpy(fine_enough(data["joints"]))
        valid = torch.from_numpy(data["valid"].astype(bool))
        motion = cls(joints, valid, float(data["fps"]), float(data["t0"]), skeleton)
        if joints.numel() == 0:
            raise ValueError("it holds no frames")
        if not (0 < motion.fps < float("inf")):
            raise ValueError(f"it has {motion.fps:g} frames a second, which must be more than 0")
        if not torch.isfinite(joints).all():
            raise ValueError("it holds joint positions that are not finite")
        return motion
