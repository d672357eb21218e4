"""What there is to see of a goal, as plain data: the viewer draws marks and knows no goal by name."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Any, Literal

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from objectives.parameters import FloorPoint, Point, instances
from objectives.tracks import TrackBase

Shape = Literal["ball", "ring", "line", "capsule", "arrow"]
Role = Literal["goal", "way", "obstacle"]

_SAMPLES = 120
"""Points by which a track is drawn; the bend of a circle between two is under a thousandth of its radius."""
_AROUND = 0.2
"""Least radius (m) of the ring around a joint of which a height is asked: wider than the head or limb in it."""
_ARROW, _PER_SPAN = 0.5, 3
"""Metres that an arrow is long, and arrows by which a span of frames is shown: its first, middle and last."""


@dataclass(frozen=True)
class Mark:
    """One thing to draw.

    Attributes:
        shape: "ball" or horizontal "ring" around each point, "line" through them, "capsule" or "arrow" from the first
            to the second.
        points: world m, ``[P, 3]``; one set for each time, ``[T, P, 3]``, that may move. Nan heights are the floor's.
        radius: m, of balls, rings and capsules; the viewer draws what would be too small to see a little larger.
        role: "goal" is wanted, "obstacle" is kept clear of, "way" is followed.
        times: seconds of the T sets of points, or None for one set.
    """

    shape: Shape
    points: Float[Tensor, "*t P 3"]
    radius: float = 0.0
    role: Role = "goal"
    times: Float[Tensor, " T"] | None = None


def rectangle(
    x: tuple[float, float], z: tuple[float, float], height: float = math.nan, role: Role = "goal"
) -> list[Mark]:
    """The outline of a rectangle between bounds in x and z at a height (world m); nothing where it has no end."""
    corners = [(x[i], height, z[j]) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1), (0, 0))]
    return [Mark("line", torch.tensor(corners), role=role)] if math.isfinite(sum(x) + sum(z)) else []


def marks_of_targets(
    targets: Float[Tensor, "T n 3"],
    points: Float[Tensor, "T n 3"] | None,
    mask: Bool[Tensor, "T n"],
    radius: float,
) -> list[Mark]:
    """Where entries are drawn to: a ball (a ring where a coordinate is free) for each place, a line where it moves.

    Args:
        targets: world m, nan on free coordinates.
        points: where the entries are, which stands for their free x and z; None where it is not known.
        mask: frames at which they are drawn there.
        radius: of balls and rings, m: how near is near enough.
    """
    found: list[Mark] = []
    stated = mask & ~targets.isnan().all(-1)
    for entry in range(targets.shape[1]):
        for frames in _runs(stated[:, entry]):
            places = targets[frames, entry].clone()
            steps = len(places.nan_to_num(nan=math.inf).unique_consecutive(dim=0))
            if points is not None:
                places[:, ::2] = torch.where(
                    places[:, ::2].isnan(), points[frames, entry][:, ::2].to(places), places[:, ::2]
                )
            if steps > 2:
                found.append(Mark("line", places))
                continue
            free = targets[frames[0], entry].isnan()
            shape: Shape = "ring" if bool(free.any()) else "ball"
            size = max(radius, _AROUND) if bool(free[::2].any()) else radius
            found += [Mark(shape, place[None], size) for place in (places[:1] if steps == 1 else places)]
    return found


def marks_of_aims(
    directions: Float[Tensor, "T n 3"], points: Float[Tensor, "T n 3"], mask: Bool[Tensor, "T n"]
) -> list[Mark]:
    """How entries shall point: arrows from where they are, at a few frames of each span in which they shall.

    Args:
        directions: unit vectors, nan where nothing is stated.
        points: where the entries are, world m.
        mask: frames at which they shall point so.
    """
    found: list[Mark] = []
    for entry in range(directions.shape[1]):
        for frames in _runs(mask[:, entry] & directions[:, entry].isfinite().all(-1)):
            shown = {frames[round(share * (len(frames) - 1) / (_PER_SPAN - 1))] for share in range(_PER_SPAN)}
            for frame in sorted(shown):
                begin = points[frame, entry]
                found.append(Mark("arrow", torch.stack([begin, begin + _ARROW * directions[frame, entry].to(begin)])))
    return found


def _runs(mask: Bool[Tensor, " T"]) -> Iterator[list[int]]:
    """Neighbouring frames of a mask, run by run."""
    frames = mask.nonzero()[:, 0].tolist()
    for _, run in groupby(enumerate(frames), key=lambda pair: pair[1] - pair[0]):
        yield [frame for _, frame in run]


def marks_of_parameters(parameters: Mapping[str, Any], radius: float) -> list[Mark]:
    """What can be seen of a goal that says nothing itself: its points, places on the floor and tracks."""
    values = dict(parameters)
    found = [Mark("ball", torch.tensor([list(p)]), radius) for p in instances(values, Point)]
    found += [Mark("ring", torch.tensor([[p.x, math.nan, p.z]]), radius) for p in instances(values, FloorPoint)]
    for track in instances(values, TrackBase):
        times = torch.linspace(*track.span, _SAMPLES, dtype=torch.float64)
        found += [Mark("line", column) for column in track.position(times).unbind(1)]
    return found
