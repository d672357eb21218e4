"""Recorded poses and motions as parameters of goals: of a file, or as data.

Files are read by a function that a room above hands in (`read_with`), as this package knows but our own format. What
is read has the bones of whoever was recorded; goals put it on those of the body that they are about.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import torch
from jaxtyping import Float
from pydantic import ConfigDict, Discriminator, GetJsonSchemaHandler, Tag, model_validator
from torch import Tensor

from objectives.parameters import File, Positive
from objectives.tracks import Array
from scenes.errors import UserError, clipped
from scenes.motion.frames import Place
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D
from scenes.numbers import MOST
from scenes.tables import Table

_JOINTS = len(HUMANML3D.names)
Reader = Callable[[Path, float | None], Motion]
_readers: list[Reader] = [lambda file, _: Motion.load(file)]


def read_with(reader: Reader) -> None:
    """Read motions with this from now on: of a file, and its frames a second where those are stated.

    It raises UserError for files that it cannot read.
    """
    _readers[:] = [reader]


class _Recorded(Table):
    """What a recording states: either a file, or positions."""

    model_config = ConfigDict(arbitrary_types_allowed=True)
    IN_WORDS: ClassVar[str]
    AXES: ClassVar[int]
    """Of its positions."""

    file: File | None = None
    positions: Array = None
    fps: Positive | None = None

    @model_validator(mode="before")
    @classmethod
    def _shorthand(cls, value: Any) -> Any:
        """Texts, arrays and motions as tables."""
        if isinstance(value, str | Path):
            name, _, part = str(value).partition("#")
            return {"file": name, **cls._part(part)}
        if isinstance(value, Motion):
            if value.joints.ndim != 3 or value.skeleton.names != HUMANML3D.names:
                raise UserError("takes one motion [T, 22, 3] of HumanML3D's joints")
            joints = value.joints.detach().double().cpu().numpy()[value.valid.cpu().numpy()]
            return cls._of_motion(joints, value.fps)
        return {"positions": value} if isinstance(value, list | tuple | np.ndarray | Tensor) else value

    @classmethod
    def _part(cls, text: str) -> Mapping[str, Any]:
        raise NotImplementedError

    @classmethod
    def _of_motion(cls, joints: np.ndarray, fps: float) -> Mapping[str, Any]:
        raise NotImplementedError

    @model_validator(mode="after")
    def _readable(self) -> _Recorded:
        if (self.file is None) == (self.positions is None):
            raise UserError("state either a file or positions")
        _ = self.joints
        return self

    @property
    def joints(self) -> np.ndarray:
        """World positions, m, in double precision."""
        raise NotImplementedError

    def _stated(self) -> np.ndarray:
        """The positions, where they are no file's."""
        given = np.asarray(self.positions)
        given = given[0] if given.ndim == self.AXES + 1 and len(given) == 1 else given  # a motion of one frame
        if given.dtype.kind not in "fiu" or given.ndim != self.AXES or given.shape[-2:] != (_JOINTS, 3):
            frames = "[frames, 22, 3]" if self.AXES == 3 else "[22, 3]"
            raise UserError(f"positions must be numbers of shape {frames}, not {list(given.shape)}")
        if not given.size or not (np.abs(given) <= MOST).all():
            raise UserError("positions must be finite, and at least one frame")
        return given.astype(np.float64)

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        array: dict[str, Any] = {"type": "number"}
        for _ in range(cls.AXES):
            array = {"type": "array", "items": array}
        return {"anyOf": [{"type": "string"}, array, handler(schema)]}


class Pose(_Recorded):
    """A body at one moment: "clip.bvh#2.4" in a task file.

    Attributes:
        file: of a motion, of which of several samples the first counts.
        time: seconds on the file's clock, which has two frames or more.
        positions: instead of a file, of all joints, ``[22, 3]``, world m.
        fps: of the file, where it does not say.
    """

    IN_WORDS = "'FILE#TIME'"
    AXES = 2
    time: float | None = None

    @classmethod
    def _part(cls, text: str) -> Mapping[str, Any]:
        return {"time": _seconds(text)} if text else {}

    @classmethod
    def _of_motion(cls, joints: np.ndarray, fps: float) -> Mapping[str, Any]:
        if len(joints) != 1:
            raise UserError(f"takes one frame, and the motion has {len(joints)}; choose one")
        return {"positions": joints[0]}

    @cached_property
    def joints(self) -> np.ndarray:
        """``[22, 3]``."""
        if self.file is None:
            return self._stated()
        motion = _read(self.file, self.fps)
        if self.time is None and motion.frames > 1:
            raise UserError(f"clip '{self.file}' has {motion.frames} frames; say when, such as '{self.file.name}#1.5'")
        when = motion.t0 if self.time is None else _inside(self.time, motion, self.file)
        found: np.ndarray = _at(motion.joints, (torch.tensor([when]) - motion.t0) * motion.fps)[0].numpy()
        return found

    def moved(self, by: Place) -> Pose:
        """The same so much (m) further."""
        return Pose(positions=self.joints + np.array(by))


def _several(value: Any) -> str:
    """Whether this is a list of poses: the positions of one are a list of lists of numbers."""
    one = not isinstance(value, list | tuple) or (
        bool(value) and isinstance(value[0], list | tuple) and not any(isinstance(x, list | tuple) for x in value[0])
    )
    return "one" if one else "several"


Poses = Annotated[Annotated[Pose, Tag("one")] | Annotated[list[Pose], Tag("several")], Discriminator(_several)]
"""One pose or a list of them."""


class Clip(_Recorded):
    """A motion, or a part of one: "clip.bvh" or "clip.bvh#1.5:4" in a task file.

    Attributes:
        file: of a motion, of which of several samples the first counts.
        begin, end: the part, seconds on the file's clock; by default all of it.
        positions: instead of a file, ``[T, 22, 3]``, world m.
        fps: of the positions (20 by default), or of the file where it does not say.
    """

    IN_WORDS = "'FILE' or 'FILE#FROM:TO'"
    AXES = 3
    begin: float | None = None
    end: float | None = None

    @classmethod
    def _part(cls, text: str) -> Mapping[str, Any]:
        begin, colon, end = text.partition(":")
        if text and not colon:
            raise UserError(
                f"'#{clipped(text)}' is no part of a clip; write '#1.5:4' for what lies between these times"
            )
        return {key: _seconds(word) for key, word in (("begin", begin), ("end", end)) if word}

    @classmethod
    def _of_motion(cls, joints: np.ndarray, fps: float) -> Mapping[str, Any]:
        return {"positions": joints, "fps": float(fps)}

    @cached_property
    def recording(self) -> tuple[np.ndarray, float]:
        """Positions ``[T, 22, 3]`` (m) and frames a second."""
        if self.file is None:
            return self._stated(), self.fps or 20.0
        motion = _read(self.file, self.fps)
        begin = motion.t0 if self.begin is None else _inside(self.begin, motion, self.file)
        last = motion.t0 + (motion.frames - 1) / motion.fps
        end = last if self.end is None else _inside(self.end, motion, self.file)
        if end < begin:
            raise UserError(f"a part of a clip goes from a time to a later one, not from {begin:g} to {end:g} s")
        steps = torch.arange(int((end - begin) * motion.fps + 1e-6) + 1, dtype=torch.float64)
        return _at(motion.joints, steps + (begin - motion.t0) * motion.fps).numpy(), motion.fps

    @property
    def joints(self) -> np.ndarray:
        """``[T, 22, 3]``."""
        return self.recording[0]

    @property
    def seconds(self) -> float:
        """From its first frame to its last."""
        joints, fps = self.recording
        return (len(joints) - 1) / fps

    def at(self, times: Float[Tensor, " N"]) -> Float[Tensor, "N 22 3"]:
        """Positions (m) so many seconds after its first frame; held at its ends."""
        joints, fps = self.recording
        return _at(torch.from_numpy(joints), times.double().cpu() * fps).to(times)

    def moved(self, by: Place) -> Clip:
        """The same so much (m) further."""
        joints, fps = self.recording
        return Clip(positions=joints + np.array(by), fps=fps)


def _read(file: Path, fps: float | None) -> Motion:
    """One motion of a file, in double precision and without padding."""
    motion = _readers[0](file, fps)
    if motion.skeleton.names != HUMANML3D.names:
        raise UserError(f"clip '{file}' has other joints than HumanML3D's; convert it first")
    while motion.joints.ndim > 3:
        motion = motion[0]
    return Motion(motion.joints.double()[motion.valid], fps=motion.fps, t0=motion.t0)


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not math.isfinite(seconds):
        raise UserError(f"'{clipped(text)}' after '#' is no time in seconds")
    return seconds


def _inside(time: float, motion: Motion, file: Path) -> float:
    """The time, which the clip must have."""
    begin, end = motion.t0, motion.t0 + motion.seconds
    if not begin - 1e-6 <= time <= end + 1e-6:
        raise UserError(f"time {time:g} s lies outside clip '{file}', which runs from {begin:g} to {end:g} s")
    return time


def _at(joints: Float[Tensor, "T 22 3"], places: Float[Tensor, " N"]) -> Float[Tensor, "N 22 3"]:
    """Straight lines between frames, at places counted in frames; held at the ends."""
    places = places.clamp(0, len(joints) - 1)
    near = places.round()
    places = torch.where((places - near).abs() < 1e-3, near, places)  # a frame's own time hits it
    low = places.floor().long()
    share = (places - low)[:, None, None].to(joints)
    return torch.lerp(joints[low], joints[(low + 1).clamp_max(len(joints) - 1)], share)
