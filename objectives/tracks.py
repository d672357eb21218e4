"""Positions as functions of time: waypoints, lines, arcs, sinusoids, and arrays from files.

Times are seconds on the task's clock, positions world metres. `Track` is the union of all of them, told apart
by `kind` in a task file::

    track = {kind = "arc", center = [0, 0.9, 2], radius = 1.5, angles = [0, 1.57], times = [1, 4]}
"""

from __future__ import annotations

import math
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float
from pydantic import BeforeValidator, ConfigDict, Field, WithJsonSchema, model_validator
from torch import Tensor

from objectives.parameters import File, Point, Positive
from scenes.archive import load_npy, load_npz
from scenes.errors import UserError, clipped
from scenes.files import readable
from scenes.motion.frames import Place
from scenes.numbers import MOST
from scenes.tables import Table

Span = tuple[float, float]
AnyTrack = TypeVar("AnyTrack", bound="TrackBase")


class TrackBase(Table):
    """What every track can do."""

    model_config = ConfigDict(arbitrary_types_allowed=True)

    @property
    def span(self) -> Span:
        """First and last time of the track, seconds."""
        raise NotImplementedError

    @property
    def columns(self) -> int:
        """Number n of points that the track moves: 1, or the joints of an array."""
        return 1

    def position(self, times: Float[Tensor, " T"]) -> Float[Tensor, "T n 3"]:
        """World positions, metres; held at the ends outside the span."""
        raise NotImplementedError

    def active(self, times: Float[Tensor, " T"]) -> Bool[Tensor, "T n"]:
        """Where the track states a position: inside its span (and inside an array's mask)."""
        begin, end = self.span
        inside = (times >= begin - 1e-4) & (times <= end + 1e-4)
        return inside[:, None].expand(-1, self.columns)

    def later(self: AnyTrack, by: float) -> AnyTrack:
        """The same so many seconds later."""
        times: Any = getattr(self, "times", ())
        return self.model_copy(update={"times": type(times)(time + by for time in times)})

    def _phase(self, times: Float[Tensor, " T"]) -> Float[Tensor, "T 1 1"]:
        """0 at the start of the span, 1 at its end, held outside."""
        begin, end = self.span
        return ((times - begin) / (end - begin)).clamp(0, 1)[:, None, None]


class _Timed(TrackBase):
    times: Span

    @model_validator(mode="after")
    def _ordered(self) -> _Timed:
        if not self.times[1] > self.times[0]:
            raise UserError(f"track times must increase, not {list(self.times)}")
        return self

    @property
    def span(self) -> Span:
        return self.times


class WaypointTrack(TrackBase):
    """Straight from waypoint to waypoint.

    Attributes:
        times: seconds, increasing, one for each position.
        positions: world points, metres.
    """

    kind: Literal["waypoints"] = "waypoints"
    times: list[float]
    positions: list[Point]

    @model_validator(mode="after")
    def _matching(self) -> WaypointTrack:
        if len(self.times) != len(self.positions) or not self.times:
            raise UserError(
                f"track has {len(self.times)} times for {len(self.positions)} positions; state one for each"
            )
        if any(b <= a for a, b in pairwise(self.times)):
            raise UserError(f"track times must increase, not {self.times}")
        return self

    @property
    def span(self) -> Span:
        return self.times[0], self.times[-1]

    def position(self, times: Float[Tensor, " T"]) -> Float[Tensor, "T n 3"]:
        points, knots = times.new_tensor(self.positions), times.new_tensor(self.times)
        if len(knots) == 1:
            return points.expand(len(times), 3)[:, None]
        right = torch.searchsorted(knots, times.contiguous()).clamp(1, len(knots) - 1)
        left = right - 1
        share = ((times - knots[left]) / (knots[right] - knots[left])).clamp(0, 1)[:, None]
        return torch.lerp(points[left], points[right], share)[:, None]


class Line(_Timed):
    """Straight from `start` to `end` (world points, m) at constant speed.

    Attributes:
        start: where the track begins.
        end: where it ends.
        times: [begin, end], seconds.
    """

    kind: Literal["line"] = "line"
    start: Point
    end: Point

    def position(self, times: Float[Tensor, " T"]) -> Float[Tensor, "T n 3"]:
        a, b = times.new_tensor(self.start), times.new_tensor(self.end)
        return a + (b - a) * self._phase(times)


class Arc(_Timed):
    """Part of a horizontal circle at constant speed.

    Attributes:
        center: of the circle, world m; the track stays at its height.
        radius: metres.
        angles: [from, to], radians about +y: 0 lies in +z of the center, pi/2 in +x. More than 2 pi winds on.
        times: [begin, end], seconds.
    """

    kind: Literal["arc"] = "arc"
    center: Point
    radius: Positive
    angles: Span

    def position(self, times: Float[Tensor, " T"]) -> Float[Tensor, "T n 3"]:
        angle = self.angles[0] + (self.angles[1] - self.angles[0]) * self._phase(times)
        circle = torch.cat([angle.sin(), torch.zeros_like(angle), angle.cos()], dim=-1)
        return times.new_tensor(self.center) + self.radius * circle


class Sinusoid(_Timed):
    """A line from `start` to `end` with a wave across it: + amplitude sin(2 pi cycles u + phase), u from 0 to 1.

    Attributes:
        start: where the line begins, world m.
        end: where it ends; equal to `start` for a wave on the spot.
        amplitude: vector of the swing, metres.
        cycles: full waves over the whole track.
        phase: radians at the start.
        times: [begin, end], seconds.
    """

    kind: Literal["sinusoid"] = "sinusoid"
    start: Point
    end: Point
    amplitude: tuple[float, float, float]
    cycles: float = 1.0
    phase: float = 0.0

    def position(self, times: Float[Tensor, " T"]) -> Float[Tensor, "T n 3"]:
        u = self._phase(times)
        a, b = times.new_tensor(self.start), times.new_tensor(self.end)
        wave = (2 * math.pi * self.cycles * u + self.phase).sin()
        return a + (b - a) * u + times.new_tensor(self.amplitude) * wave


def _array(value: Any) -> Any:
    return value if value is None else np.asarray(value)


Array = Annotated[np.ndarray | None, BeforeValidator(_array), WithJsonSchema({"type": ["array", "null"]})]
"""Numbers of any shape, or none."""


class ArrayTrack(TrackBase):
    """Positions sampled at a fixed rate, from a file or as an array.

    Attributes:
        file: `.npy` with positions, or `.npz` with `positions` (or `joints`) and, if wanted, `mask`.
        positions: the array itself instead of a file, ``[T, 3]`` or ``[T, n, 3]``, world m. A row that is not
            finite states nothing.
        mask: ``[T]`` or ``[T, n]``, true where a position is stated.
        fps: samples a second.
        begin: time of the first sample, seconds.
    """

    kind: Literal["array"] = "array"
    file: File | None = None
    positions: Array = None
    mask: Array = None
    fps: Positive = 20.0
    begin: float = 0.0

    @cached_property
    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions ``[T, n, 3]`` with zeros where nothing is stated, and the mask ``[T, n]``."""
        if (self.file is None) == (self.positions is None):
            raise UserError("an array track needs either 'file' or 'positions'")
        positions, mask = (self.positions, self.mask) if self.file is None else _read(self.file, self.mask)
        source = "positions" if self.file is None else f"file '{self.file}'"
        return _samples(source, np.asarray(positions), mask)

    @model_validator(mode="after")
    def _readable(self) -> ArrayTrack:
        _ = self.samples
        return self

    @property
    def span(self) -> Span:
        return self.begin, self.begin + (len(self.samples[0]) - 1) / self.fps

    @property
    def columns(self) -> int:
        return int(self.samples[0].shape[1])

    def position(self, times: Float[Tensor, " T"]) -> Float[Tensor, "T n 3"]:
        points = torch.as_tensor(self.samples[0], dtype=times.dtype, device=times.device)
        low, high, share = self._neighbours(times)
        return torch.lerp(points[low], points[high], share[:, None, None])

    def active(self, times: Float[Tensor, " T"]) -> Bool[Tensor, "T n"]:
        mask = torch.as_tensor(self.samples[1], device=times.device)
        low, high, share = self._neighbours(times)
        return super().active(times) & mask[low] & (mask[high] | (share == 0)[:, None])

    def moved(self, by: Place) -> ArrayTrack:
        """The track that lies so much (m) further."""
        points, stated = self.samples
        return ArrayTrack(positions=points + np.array(by), mask=stated, fps=self.fps, begin=self.begin)

    def later(self, by: float) -> ArrayTrack:
        """The track so many seconds later."""
        return self.model_copy(update={"begin": self.begin + by})

    def _neighbours(self, times: Float[Tensor, " T"]) -> tuple[Tensor, Tensor, Tensor]:
        last = len(self.samples[0]) - 1
        where = ((times - self.begin) * self.fps).clamp(0, last)
        # A motion at the track's own rate must hit the samples, not blend two of them through rounding.
        where = torch.where((where - where.round()).abs() < 1e-3, where.round(), where)
        low = where.floor().long()
        return low, (low + 1).clamp_max(last), where - low


def _read(path: Path, mask: np.ndarray | None) -> tuple[np.ndarray, np.ndarray | None]:
    readable(path, "track file")
    try:
        if path.suffix.lower() == ".npy":
            return load_npy(path), mask
        loaded = load_npz(path)
    except (OSError, ValueError) as error:
        raise UserError(
            f"track file '{path}' is not an .npy or .npz file of numbers ({clipped(str(error), 120)})"
        ) from error
    key = next((k for k in ("positions", "joints") if k in loaded), None)
    if key is not None:
        return loaded[key], loaded.get("mask") if mask is None else mask
    names = ", ".join(loaded) or "nothing"
    raise UserError(f"track file '{path}' has no array 'positions' or 'joints', it holds {names}")


def _samples(source: str, positions: np.ndarray, mask: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    if (
        positions.dtype.kind not in "fiu"
        or positions.ndim not in (2, 3)
        or positions.shape[-1] != 3
        or 0 in positions.shape
    ):
        raise UserError(f"track {source} must hold numbers of shape [T, 3] or [T, n, 3], not {positions.shape}")
    points = positions.reshape(len(positions), -1, 3).astype(np.float64)
    stated = np.asarray(np.isfinite(points).all(axis=-1))
    if (np.abs(points[stated]) > MOST).any():
        raise UserError(f"track {source} has positions of over {MOST:.0e} m")
    if mask is not None:
        if mask.dtype.kind not in "bfiu":
            raise UserError(f"track {source} has a mask of the type {mask.dtype}; give true and false")
        if mask.shape not in (points.shape[:1], points.shape[:2]):
            raise UserError(f"track {source} has a mask of shape {mask.shape} for positions of shape {positions.shape}")
        stated = stated & mask.astype(bool).reshape(len(points), -1)
    if not stated.any():
        raise UserError(f"track {source} states no position: every row is masked or not finite")
    return np.where(stated[..., None], points, 0.0), stated


Track = Annotated[WaypointTrack | Line | Arc | Sinusoid | ArrayTrack, Field(discriminator="kind")]
"""Any of the tracks."""


def held_position(place: Point | TrackBase, times: Float[Tensor, " T"]) -> Float[Tensor, "T 1 3"]:
    """Where an obstacle is: a fixed point, or a track held at its ends; metres."""
    if not isinstance(place, TrackBase):
        return times.new_tensor(place).expand(len(times), 1, 3)
    if place.columns != 1:
        raise UserError(f"an obstacle follows a track of one point, this one has {place.columns}")
    if isinstance(place, ArrayTrack) and not place.samples[1].all():
        raise UserError("an obstacle is somewhere at every time, so its track can have no masked or non-finite rows")
    return place.position(times)
