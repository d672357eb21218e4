"""The proxy body: spheres on joints and capsules on bones, sampled as points with radii.

A motion is 22 moving points; walls are met by flesh. `ProxyBody` puts the flesh on: its samples are fixed
linear combinations of the joints, so that one small matrix product makes them and gradients pass through.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from scenes.errors import UserError, shown
from scenes.motion.bones import rest_pose
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D, Skeleton, size_of

STRETCH = 1.1
"""Bones up to this much longer than the skeleton's keep gaps between samples below the capsule's radius."""

THINNEST, THICKEST = 1e-3, 10.0
"""Metres: radii of a body. Thinner bones would need thousands of samples."""

STATURE = 1.7
"""Metres: of `ProxyBody.human()`. HumanML3D's hips stand 0.89 m over the soles, which is 0.53 of it (D. A. Winter,
Biomechanics and Motor Control of Human Movement, 2009, fig. 4.1); the means of ANSUR II are 1.63 and 1.76 m."""

SHORTEST, TALLEST = 1.2, 2.1
"""Metres: statures that can be asked for. Younger children have other proportions than adults."""

SMALLEST, LARGEST = 0.4, 1.6
"""Legs that motions are made for, as multiples of an adult's: people of 0.7 to 2.7 m, the tallest ever measured."""

_HUMAN: dict[str, Any] = tomllib.loads((Path(__file__).parent / "human.toml").read_text(encoding="utf-8"))

SOURCE: str = _HUMAN["source"]


@dataclass(frozen=True)
class BodyCapsule:
    """A capsule from joint `a` to joint `b` (indices) of one radius (m); `origin` says where the radius comes from."""

    a: int
    b: int
    radius: float
    origin: str


@dataclass(frozen=True)
class BodySphere:
    """A sphere on joint `joint`, or `beyond` times the bone `base` -> `joint` past it; radius in metres."""

    name: str
    joint: int
    radius: float
    origin: str
    base: int = -1
    beyond: float = 0.0


class Segments(NamedTuple):
    """The body as C capsules: ends `a` and `b` (world, m), which coincide for a sphere, `radius` (m), and `owners`.

    An owner is the joint to name when the capsule hits something, and to exempt: of a bone, the one further out.
    """

    a: Float[Tensor, "*b C 3"]
    b: Float[Tensor, "*b C 3"]
    radius: Float[Tensor, " C"]
    owners: list[str]


@dataclass(frozen=True)
class _Samples:
    weights: Tensor  # [M, J]
    radii: Tensor  # [M]
    owners: tuple[int, ...]
    parts: tuple[str, ...]


@dataclass(frozen=True)
class ProxyBody:
    """Spheres and capsules on a skeleton. `ProxyBody.human()` is the adult of the tables, `DEFAULT_BODY` the same.

    Bones and radii belong together: motions that are made for a body are on its skeleton.

    Ends of capsules carry the spheres of their joints, so a shank is round at the knee and thin at the ankle.
    Joints stop at the wrist and at the ball of the foot: a sphere covers the palm and one the back of the heel;
    fingers (about 8 cm), toes (about 6 cm) and the sole of the heel are not covered.

    Attributes:
        skeleton: the joints the indices speak of.
        spheres: one on every joint, in the skeleton's order, then those past the joints.
        capsules: one on every bone.
        sole_offset: metres from the lowest foot joint down to the sole. A canonical motion has that joint at
            y = 0, so placing it at `floor.height + sole_offset` lets the foot spheres touch the floor.
        source: citation of the tables.

    Raises:
        UserError: joints that the skeleton does not have, or radii that no body has.
    """

    skeleton: Skeleton
    spheres: tuple[BodySphere, ...]
    capsules: tuple[BodyCapsule, ...]
    sole_offset: float
    source: str = SOURCE

    def __post_init__(self) -> None:
        joints = range(len(self.skeleton.names))
        ends = [(s.joint, s.joint if s.base == -1 else s.base) for s in self.spheres]
        if not all(a in joints and b in joints for a, b in (*ends, *((c.a, c.b) for c in self.capsules))):
            raise UserError(f"a body has spheres or capsules on joints beyond its {len(joints)}")
        sizes = [*(sphere.radius for sphere in self.spheres), *(capsule.radius for capsule in self.capsules)]
        if not sizes or not all(THINNEST <= size <= THICKEST for size in sizes):
            raise UserError(f"a body has radii from {THINNEST:g} to {THICKEST:g} m, not {shown(sizes)}")
        if not all(
            abs(number) <= THICKEST / THINNEST for number in (self.sole_offset, *(s.beyond for s in self.spheres))
        ):
            raise UserError("a body has a sphere, or its soles, far from its joints")

    @classmethod
    def human(cls, height: float = STATURE) -> ProxyBody:
        """A person on HumanML3D's skeleton, radii from ANSUR II means of both sexes, all in proportion to the stature.

        People of other heights are taken for adults seen larger or smaller (geometric similarity). Of an adult that
        holds within a few percent; a child of 1.2 m has shorter legs, by about 3 %, and a larger head than that.

        Args:
            height: stature (m), from `SHORTEST` to `TALLEST`.
        """
        if not SHORTEST <= height <= TALLEST:
            raise UserError(f"a body's height is {shown(height)}; give {SHORTEST:g} to {TALLEST:g} m")
        adult = cls(HUMANML3D, _human_spheres(), _human_capsules(), _SOLE, SOURCE)
        if height == STATURE:
            return adult
        return replace(adult.scaled(height / STATURE), source=f"{SOURCE}, in proportion to a height of {height:g} m")

    def scaled(self, by: float) -> ProxyBody:
        """The same proportions, so many times as large."""
        spheres = tuple(replace(sphere, radius=by * sphere.radius) for sphere in self.spheres)
        capsules = tuple(replace(capsule, radius=by * capsule.radius) for capsule in self.capsules)
        return replace(
            self,
            skeleton=self.skeleton.scaled(by),
            spheres=spheres,
            capsules=capsules,
            sole_offset=by * self.sole_offset,
        )

    @cached_property
    def height(self) -> float:
        """Stature (m), as people stand, whose backs are not as straight as the T-pose's."""
        top = float((self._rest[:, 1] + self.radii(self._rest)).max())
        return _UPRIGHT * (top + self.skeleton.legs + self.sole_offset)

    @cached_property
    def breadth(self) -> float:
        """Half the width (m) of shoulders or hips, whichever are wider."""
        joints = {self.skeleton.index(f"{side}_{part}") for side in ("left", "right") for part in ("shoulder", "hip")}
        rest = rest_pose(self.skeleton)
        return max(abs(float(rest[s.joint, 0])) + s.radius for s in self.spheres if s.joint in joints)

    @property
    def size(self) -> float:
        """How many times as long its legs are as an adult's: steps, speeds and heights of its motions are so, too."""
        return size_of(self.skeleton)

    @cached_property
    def _rest(self) -> Float[Tensor, "M 3"]:
        """Samples in the T-pose, the root at the origin."""
        return self.points_of(rest_pose(self.skeleton))

    def points(self, motion: Motion) -> tuple[Float[Tensor, "*b T M 3"], Float[Tensor, " M"]]:
        """World positions of all samples (m) and their radii (m); raises UserError for another skeleton."""
        self._check(motion)
        return self.points_of(motion.joints), self.radii(motion.joints)

    def segments(self, motion: Motion) -> Segments:
        """All spheres, and capsules from their first sample to their last; raises UserError for another skeleton."""
        self._check(motion)
        weights, radii, owners = self._ends
        a, b = (torch.einsum("cj,...jd->...cd", end, motion.joints) for end in weights.to(motion.joints))
        return Segments(a, b, radii.to(motion.joints), [self.skeleton.names[j] for j in owners])

    def _check(self, motion: Motion) -> None:
        if motion.skeleton.names != self.skeleton.names:
            raise UserError(
                f"the motion has joints {', '.join(motion.skeleton.names[:3])}, … ({len(motion.skeleton.names)}), but "
                f"this body is made for {', '.join(self.skeleton.names[:3])}, … ({len(self.skeleton.names)}); "
                "retarget the motion or build a ProxyBody for its skeleton"
            )

    def points_of(self, joints: Float[Tensor, "*b J 3"]) -> Float[Tensor, "*b M 3"]:
        """World positions of all samples (m) for joint positions (m), linear in them."""
        return torch.einsum("mj,...jd->...md", self._samples.weights.to(joints), joints)

    def radii(self, like: Tensor | None = None) -> Float[Tensor, " M"]:
        """Radius of every sample (m), float32 or as `like`."""
        return self._samples.radii.float() if like is None else self._samples.radii.to(like)

    @property
    def owners(self) -> list[str]:
        """The joint nearest to each sample: the one to exempt, and to name when the sample hits something."""
        return [self.skeleton.names[j] for j in self._samples.owners]

    @property
    def parts(self) -> list[str]:
        """What each sample belongs to: a joint, a bone such as 'left_hip-left_knee', or 'left_palm'."""
        return list(self._samples.parts)

    @property
    def count(self) -> int:
        """Number of samples M."""
        return len(self._samples.owners)

    def mask(self, exempt: Iterable[str] = ()) -> Bool[Tensor, " M"]:
        """True for the samples that count, False for those owned by joints in `exempt`.

        Raises UserError for a joint the skeleton does not have.
        """
        out = {self.skeleton.index(name) for name in exempt}
        return torch.tensor([owner not in out for owner in self._samples.owners])

    def table(self) -> list[dict[str, str | float]]:
        """Rows `{"part", "radius_m", "origin"}` of all spheres and capsules, for printing."""
        names = self.skeleton.names
        rows: list[dict[str, str | float]] = [
            {"part": s.name, "radius_m": round(s.radius, 4), "origin": s.origin} for s in self.spheres
        ]
        rows += [
            {"part": f"{names[c.a]}-{names[c.b]}", "radius_m": round(c.radius, 4), "origin": c.origin}
            for c in self.capsules
        ]
        return rows

    def _weights(self, blends: Sequence[dict[int, float]]) -> Tensor:
        """Weights of the joints in points, ``[n, J]`` float64."""
        weights = torch.zeros(len(blends), len(self.skeleton.names), dtype=torch.float64)
        for point, blend in enumerate(blends):
            for joint, weight in blend.items():
                weights[point, joint] = weight
        return weights

    @cached_property
    def _ends(self) -> tuple[Tensor, Tensor, list[int]]:
        """Joints to both ends of all parts, ``[2, C, J]``, their radii ``[C]`` and owners."""
        parts = [(_blend(s), _blend(s), s.radius, s.joint) for s in self.spheres]
        for c in self.capsules:
            steps = self._steps(c)
            if steps > 1:  # else the spheres of its joints cover it
                near, far = {c.a: 1 - 1 / steps, c.b: 1 / steps}, {c.a: 1 / steps, c.b: 1 - 1 / steps}
                parts.append((near, far, c.radius, c.b))
        weights = torch.stack([self._weights([part[0] for part in parts]), self._weights([part[1] for part in parts])])
        return weights, _doubles([part[2] for part in parts]), [part[3] for part in parts]

    def _steps(self, capsule: BodyCapsule) -> int:
        """Equal steps from joint to joint; samples are between them, since the joints carry spheres of their own."""
        length = float(self.skeleton.bone_lengths[capsule.b])
        return max(1, math.ceil(STRETCH * length / capsule.radius - 1e-9))

    @cached_property
    def _samples(self) -> _Samples:
        names = self.skeleton.names
        rows = [(_blend(s), s.radius, s.joint, s.name) for s in self.spheres]
        for c in self.capsules:
            steps, part = self._steps(c), f"{names[c.a]}-{names[c.b]}"
            for t in (k / steps for k in range(1, steps)):
                rows.append(({c.a: 1 - t, c.b: t}, c.radius, c.b if t >= 0.5 else c.a, part))
        weights, radii = self._weights([row[0] for row in rows]), _doubles([row[1] for row in rows])
        return _Samples(weights, radii, tuple(row[2] for row in rows), tuple(row[3] for row in rows))


def _doubles(numbers: list[float]) -> Tensor:
    return torch.tensor(numbers, dtype=torch.float64)


def _blend(sphere: BodySphere) -> dict[int, float]:
    """Weights of the joints that carry a sphere's centre."""
    if sphere.base < 0:
        return {sphere.joint: 1.0}
    return {sphere.joint: 1.0 + sphere.beyond, sphere.base: -sphere.beyond}


# The ankle of HumanML3D's people stands 47 mm above their foot joint (reference clip), the lateral malleolus of
# ANSUR II's 0.042 of the stature, 71 mm, above the ground: the sole lies 25 mm below the foot joint.
_SOLE = 0.025
# The top of the adult's head is 1.7825 m over the soles in the T-pose.
_UPRIGHT = STATURE / 1.782513


def _mean(name: str) -> float:
    """Mean of women and men, metres."""
    return sum(_HUMAN["means"][name]) / 2000.0


def _size(*names: str) -> tuple[float, str]:
    """Mean radius (m) of girths (girth / 2 pi), depths and breadths (half of them), and how it was made."""
    radii = [_mean(n) / (2 * math.pi) if n.endswith("girth") else _mean(n) / 2 for n in names]
    how = [f"{n} / 2π" if n.endswith("girth") else f"{n} / 2" for n in names]
    return sum(radii) / len(radii), how[0] if len(how) == 1 else f"mean of {' and '.join(how)}"


def _human_spheres() -> tuple[BodySphere, ...]:
    shoulder = (
        _mean("bideltoid breadth") / 2 - 0.18,
        "bideltoid breadth / 2 less 0.18 m, the joint's distance from the middle",
    )
    # hips stand 0.106 m from the middle; a full thigh there would be wider than the hips are
    hip = ((_mean("hip breadth") / 2 - 0.106 + _size("thigh girth")[0]) / 2, "mean of thigh girth / 2π and room in hip")
    sizes = {name: _size(*means) for name, means in _HUMAN["spheres"].items()}
    sizes |= {"hip": hip, "shoulder": shoulder, "foot": (_SOLE, "the sole's depth below the joint")}
    on_joints = [
        BodySphere(name, j, *sizes[name.removeprefix("left_").removeprefix("right_")])
        for j, name in enumerate(HUMANML3D.names)
    ]
    at = HUMANML3D.index
    past = [BodySphere("crown", at("head"), *_size("head girth"), base=at("neck"), beyond=0.8)]
    for side in ("left", "right"):
        palm = BodySphere(f"{side}_palm", at(f"{side}_wrist"), *_size("hand breadth"), at(f"{side}_elbow"), 0.27)
        heel = BodySphere(f"{side}_heel", at(f"{side}_ankle"), *_size("ankle girth"), at(f"{side}_foot"), 0.25)
        past += [palm, heel]
    return (*on_joints, *past)


def _human_capsules() -> tuple[BodyCapsule, ...]:
    by_child = {name: _size(*means) for name, means in _HUMAN["capsules"].items()}
    by_child["foot"] = (1.2 * _SOLE, "1.2 times the sole's depth, as far as the instep rises")
    return tuple(
        BodyCapsule(a, b, *by_child[HUMANML3D.names[b].removeprefix("left_").removeprefix("right_")])
        for a, b in HUMANML3D.bones
    )


DEFAULT_BODY = ProxyBody.human()
"""The adult of `ProxyBody.human()`."""
