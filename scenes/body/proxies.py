"""Capsules on the links of characters and robots: fitted, stored, placed and asked how far they are from things."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import torch
from jaxtyping import Float
from pydantic import TypeAdapter, ValidationError
from torch import Tensor

from scenes.body.body import LARGEST, SMALLEST, ProxyBody
from scenes.body.capsules import SAMPLES, FittedCapsule, fit_capsule, inner_volume, quick_volume, sample_surface
from scenes.body.fit import fit_body
from scenes.body.rig import Part, Rig
from scenes.errors import UserError
from scenes.files import read_json, write_json
from scenes.mesh.content import used
from scenes.motion.skeleton import HUMANML3D
from scenes.numbers import MOST
from scenes.sdf.field import DistanceField
from scenes.tables import Strict

WORTH = 0.9
"""A part is split into one more capsule where that leaves at most this share of their volume."""

_STEP = 0.5  # radii between the samples of a capsule


@dataclass(frozen=True)
class FittedPart:
    """The capsules that stand for the triangles of one link, in the link's frame.

    Attributes:
        link: its name.
        capsules: one, or several where one was loose.
        inside: volume (m3) of the part: enclosed by the "mesh" where it is closed, else that of its convex "hull".
        reference: which of the two.
        uncovered: the farthest (m) that the surface sticks out of all capsules, 0 where nothing does.
    """

    link: str
    capsules: tuple[FittedCapsule, ...]
    inside: float
    reference: Literal["mesh", "hull"]
    uncovered: float

    @property
    def volume(self) -> float:
        """Of all capsules, cubic metres; where they overlap it counts twice."""
        return sum(capsule.volume for capsule in self.capsules)

    @property
    def volume_ratio(self) -> float:
        """Volume of the capsules over the part's; infinite for what is flat."""
        return self.volume / self.inside if self.inside > 0 else math.inf


@dataclass(frozen=True)
class Proxies:
    """Capsules around all links of a character or a robot. `fit_proxies` makes them.

    Frames are rigid transforms from links to the world, ``[*b, L, 4, 4]``, in the order of `links`; what a robot's
    forward kinematics gives, in any world as long as the distance field is in the same one.

    Attributes:
        name, source: of the rig.
        coverage: share of every part's surface that had to be covered.
        links, parents: the tree, as in `Rig`.
        rest: frames at rest, ``[L, 4, 4]`` nested, metres, y up.
        parts: what was fitted, for the links that have triangles.
        body: the same character for motions of our 22 joints, where its joints are known.
    """

    name: str
    source: str
    coverage: float
    links: tuple[str, ...]
    parents: tuple[int, ...]
    rest: tuple[tuple[tuple[float, ...], ...], ...]
    parts: tuple[FittedPart, ...]
    body: ProxyBody | None = None

    @property
    def volume_ratio(self) -> float:
        """Volume of all capsules over that of all parts."""
        inside = sum(part.inside for part in self.parts)
        return sum(part.volume for part in self.parts) / inside if inside > 0 else math.inf

    @property
    def uncovered(self) -> float:
        """The farthest (m) that any part sticks out of its capsules."""
        return max(part.uncovered for part in self.parts)

    @cached_property
    def capsules(self) -> tuple[FittedCapsule, ...]:
        """All C capsules, part after part, each in its link's frame."""
        return tuple(capsule for part in self.parts for capsule in part.capsules)

    @property
    def owners(self) -> list[str]:
        """The link of each capsule."""
        return [part.link for part in self.parts for _ in part.capsules]

    @property
    def radii(self) -> Float[Tensor, " C"]:
        """Radius of every capsule (m), float64."""
        return torch.tensor([capsule.radius for capsule in self.capsules], dtype=torch.float64)

    @property
    def frames(self) -> Float[Tensor, "L 4 4"]:
        """Frames at rest, float64."""
        return torch.tensor(self.rest, dtype=torch.float64)

    def place(self, frames: Float[Tensor, "*b L 4 4"]) -> Float[Tensor, "*b C 2 3"]:
        """World positions (m) of both ends of every capsule."""
        ends = torch.tensor([[capsule.a, capsule.b] for capsule in self.capsules], dtype=torch.float64)
        return self._carry(frames, ends, self.owners)

    def clearance(
        self, field: DistanceField, frames: Float[Tensor, "*b L 4 4"], time: Tensor | None = None
    ) -> Float[Tensor, "*b C"]:
        """Distance (m) from the surface of every capsule to what the field describes, negative inside it.

        Capsules are sampled half a radius apart or closer (very thin ones every 200th of their length). That overlooks
        nothing at flat surfaces, 1/32 of the radius where a point touches, and never more than 1/4 of it.
        Differentiable in the frames.

        Args:
            field: a scene, a grid or a primitive.
            frames: where the links are.
            time: seconds on the task's clock, broadcastable to ``[*b]``; None means 0 s.
        """
        points, radii, owner = self._samples
        placed = self._carry(frames, points[:, None], [self.owners[c] for c in owner.tolist()]).squeeze(-2)
        when = None if time is None else time[..., None].expand(placed.shape[:-1]).contiguous()
        away = field.distance(placed, when) - radii.to(placed)
        lowest = away.new_full((*away.shape[:-1], len(self.capsules)), math.inf)
        return lowest.scatter_reduce(-1, owner.expand(away.shape), away, "amin")

    def save(self, path: str | Path) -> None:
        """Write as JSON; `load` reads it back equal."""
        write_json({"format": _FORMAT, **asdict(self)}, path, allow_nan=False)

    @classmethod
    def load(cls, path: str | Path) -> Proxies:
        """Read what `save` wrote; raises UserError naming the file for anything else."""
        table = read_json(path, "body file", "write it with scenectl body FILE --json")
        written = table.pop("format", None) if isinstance(table, dict) else None
        if written not in (_FORMAT, _BEFORE):
            raise UserError(f"body file '{path}' is not of the format '{_FORMAT}'; write it with scenectl body --json")
        if written == _BEFORE and isinstance(table.get("body"), dict):
            table["body"]["skeleton"] = asdict(HUMANML3D)
        kind: Any = Annotated[cls, Strict()]
        try:
            found: Proxies = TypeAdapter(kind).validate_python(table)
        except UserError as error:  # of the body in it
            raise UserError(f"body file '{path}' is damaged: {error}; write it anew") from error
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"]))
            raise UserError(
                f"body file '{path}' is damaged at {where}: {first['msg'].lower()}; write it anew"
            ) from error
        if fault := found._fault():
            raise UserError(f"body file '{path}' is damaged: {fault}; write it anew")
        return found

    def _fault(self) -> str | None:
        """What is wrong with the numbers of a file, in words."""
        count = len(self.links)
        if len(self.parents) != count or any(not -1 <= p < j for j, p in enumerate(self.parents)):
            return "its links are no tree"
        if {len(f) for f in self.rest} != {4} or {len(row) for f in self.rest for row in f} != {4}:
            return "its frames are not 4 by 4"
        numbers = [*np.ravel(self.rest), *(x for c in self.capsules for x in (*c.a, *c.b, c.radius))]
        if (
            len(self.rest) != count
            or not (np.abs(numbers) <= MOST).all()
            or min(self.radii.tolist(), default=-1) < 0
            or not self.parts
            or not all(part.capsules for part in self.parts)
        ):
            return "it holds frames or capsules that cannot be"
        if unknown := {part.link for part in self.parts} - set(self.links):
            return f"it has no link '{min(unknown)}'"
        if self.body is not None and self.body.skeleton.names != HUMANML3D.names:
            return "its body is made for another skeleton"
        return None

    def _carry(self, frames: Tensor, points: Tensor, owners: list[str]) -> Tensor:
        """World positions of points ``[n, k, 3]``, each row in the frame of its owner."""
        if frames.ndim < 3 or frames.shape[-3:] != (len(self.links), 4, 4):
            raise UserError(
                f"frames have shape {list(frames.shape)}; give [*b, {len(self.links)}, 4, 4], one for each link of "
                f"'{self.name}' in the order of `links`"
            )
        place = {link: index for index, link in enumerate(self.links)}
        own = frames[..., [place[owner] for owner in owners], :, :]
        return torch.einsum("...nij,nkj->...nki", own[..., :3, :3], points.to(frames)) + own[..., None, :3, 3]

    @cached_property
    def _samples(self) -> tuple[Tensor, Tensor, Tensor]:
        """Points on the segments in their links' frames ``[n, 3]``, radii ``[n]`` and capsules ``[n]``."""
        points, owners = [], []
        for index, capsule in enumerate(self.capsules):
            # a capsule without thickness gets as many samples as one a hundred times as long as thick
            steps = math.ceil(capsule.length / max(_STEP * capsule.radius, capsule.length / 200, 1e-12))
            share = np.linspace(0.0, 1.0, steps + 1)[:, None]
            points.append((1 - share) * capsule.a + share * np.array(capsule.b))
            owners += [index] * len(share)
        owner = torch.tensor(owners)
        return torch.from_numpy(np.concatenate(points)), self.radii[owner], owner


_FORMAT, _BEFORE = "scenectl body 2", "scenectl body 1"
"""Bodies of format 1 had the radii of a character on an adult's bones."""


def fit_proxies(
    rig: Rig, coverage: float | int = 1.0, capsules: int = 1, joints: Mapping[str, str] | None = None
) -> Proxies:
    """Fit capsules to every link of a character or a robot that has triangles.

    Args:
        rig: from `read_rig`, `read_urdf` or `read_mjcf`.
        coverage: share of every link's surface that its capsules must hold, above 0.5; 1 holds everything.
        capsules: at most this many for a link; each but the first must save a tenth of the volume of what it splits.
        joints: {joint of our 22: link}, for a `body` that moves with motions of these; see `fit_body`.

    Raises:
        UserError: a coverage outside (0.5, 1], fewer than 1 capsules, or `joints` that do not fit.
    """
    if capsules < 1:
        raise UserError(f"{capsules} capsules were asked for; give 1 or more for each link")
    parts = tuple(fit_part(part, coverage, capsules) for part in rig.parts)
    body = None if joints is None else fit_body(rig, joints, coverage)
    rest = tuple(tuple(tuple(map(float, row)) for row in frame) for frame in rig.frames)
    return Proxies(rig.name, rig.source, float(coverage), rig.links, rig.parents, rest, parts, body)


def fit_part(part: Part, coverage: float | int = 1.0, capsules: int = 1) -> FittedPart:
    """Fit capsules to the triangles of one link; arguments as `fit_proxies` takes them."""
    pieces = [_Piece.of(part.vertices, part.faces, coverage)]
    while len(pieces) < capsules:
        worst = max(pieces, key=lambda piece: piece.excess)
        halves = worst.split(coverage)
        if halves is None or sum(half.capsule.volume for half in halves) > WORTH * worst.capsule.volume:
            break
        pieces = [piece for piece in pieces if piece is not worst] + halves
    found = tuple(piece.capsule for piece in pieces)
    surface = np.concatenate([part.vertices, sample_surface(part.vertices, part.faces, SAMPLES)])
    sticks_out = max(0.0, float(np.min([capsule.distance(surface) for capsule in found], axis=0).max()))
    return FittedPart(part.link, found, *inner_volume(part.vertices, part.faces), sticks_out)


@dataclass(frozen=True, eq=False)
class _Piece:
    """Triangles cut from a part, and the capsule around them."""

    vertices: np.ndarray
    faces: np.ndarray
    capsule: FittedCapsule

    @classmethod
    def of(cls, vertices: np.ndarray, faces: np.ndarray, coverage: float | int) -> _Piece:
        return cls(vertices, faces, fit_capsule(vertices, coverage, faces=faces))

    @property
    def excess(self) -> float:
        """Cubic metres of the capsule outside the piece's hull."""
        return self.capsule.volume - inner_volume(self.vertices)[0]

    def split(self, coverage: float | int) -> list[_Piece] | None:
        """Two pieces cut by a plane, chosen by the quick capsules on either side; None where no cut is possible."""
        from trimesh.intersections import slice_faces_plane

        _, _, principal = np.linalg.svd(self.vertices - self.vertices.mean(axis=0), full_matrices=False)
        best: tuple[float, list[tuple[np.ndarray, np.ndarray]]] | None = None
        for normal in principal:
            along = self.vertices @ normal
            for share in (0.25, 0.375, 0.5, 0.625, 0.75):
                origin = normal * (along.min() + share * np.ptp(along))
                halves = [
                    used(*slice_faces_plane(self.vertices, self.faces, sign * normal, origin)[:2])
                    for sign in (1.0, -1.0)  # triangles across the plane are cut
                ]
                if any(len(faces) == 0 for _, faces in halves):
                    continue
                volume = sum(quick_volume(vertices) for vertices, _ in halves)
                if best is None or volume < best[0]:
                    best = volume, halves
        return None if best is None else [_Piece.of(vertices, faces, coverage) for vertices, faces in best[1]]


def load_body(path: str | Path) -> ProxyBody:
    """The body of our 22 joints in a file that `Proxies.save` wrote.

    Raises:
        UserError: it holds none, or one much smaller or larger than the people whose motions there are.
    """
    found = Proxies.load(path)
    if found.body is None:
        raise UserError(
            f"body file '{path}' holds a robot or creature without our 22 joints, on which no motion is made; "
            "'scenectl retarget' moves robots"
        )
    check_size(found.body, f"body file '{path}'")
    return found.body


def check_size(body: ProxyBody, where: str) -> None:
    """Raises UserError for a body much smaller or larger than the people whose motions there are."""
    if not SMALLEST <= body.size <= LARGEST:
        raise UserError(
            f"{where} holds a body with legs of {body.skeleton.legs:.2f} m; motions are made for legs "
            f"of {SMALLEST * HUMANML3D.legs:.2f} to {LARGEST * HUMANML3D.legs:.2f} m"
        )
