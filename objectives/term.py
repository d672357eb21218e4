"""A term: one goal with its parameters, and how its residual becomes a cost."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import InitVar, dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import torch
from jaxtyping import Bool, Float, Shaped
from torch import Tensor

from objectives.aims import A_METRE, Aim, pointed
from objectives.context import Context
from objectives.kernels import Kernel, Reduction, kernel_cost, least_squares_weight
from objectives.marks import Mark, marks_of_aims, marks_of_parameters, marks_of_targets
from objectives.maths import frames_near, within
from objectives.parameters import NotNegative, Positive, later, moved, parse
from objectives.registry import EXEMPT, JOINT, TERM_KEYS, GoalSpec, Masked, get_goal
from objectives.report import TermReport
from scenes.errors import UserError, shown
from scenes.motion.frames import Place
from scenes.motion.motion import Motion
from scenes.motion.skeleton import Skeleton

Number = int | float

BESIDE = 2
"""Frames to both sides of a moment that local goals look at: speeds need one, accelerations two."""
WORTH = 0.75
"""Share of a motion's frames from which on it is shown whole."""


@dataclass(frozen=True)
class Evaluated:
    """A goal's residual with everything about it made explicit.

    Attributes:
        residual: ``[*b, T, k]``, natural units; zero where it does not apply.
        square: squared length of every entry, ``[*b, T, n]``.
        mask: where an entry applies: valid, active, inside `at` and `window`, and for `sometime` at the one frame that
            is best; ``[*b, T, n]``.
        weights: factor on the cost of each entry, ``[*b, T, n]``.
        sizes: components of each of the n entries.
        labels: name of each entry, or nothing.
        points: where each entry is, world m, or nothing.
        targets: where each entry is drawn to, world m, nan on what is free; or nothing.
        aim: how each entry shall be turned, or nothing.
        marks: tells what the goal itself says that there is to see; None where it says nothing.
        skeleton: of the motion.
        owners: joints that the goal says its entries are about, where labels do not; or nothing.
    """

    residual: Float[Tensor, "*b T k"]
    square: Float[Tensor, "*b T n"]
    mask: Bool[Tensor, "*b T n"]
    weights: Float[Tensor, "*b T n"]
    sizes: tuple[int, ...]
    labels: tuple[str, ...]
    points: Float[Tensor, "*b T n 3"] | None
    targets: Float[Tensor, "*b T n 3"] | None
    aim: Aim | None
    marks: Callable[[], Sequence[Mark]] | None
    skeleton: Skeleton
    owners: tuple[str | None, ...] = ()

    def spread(self, first: int, frames: int) -> Evaluated:
        """The same of a motion of so many frames, of which it was evaluated from the `first` on; nothing elsewhere."""
        after = frames - first - self.mask.shape[-2]
        pad = torch.nn.functional.pad

        def rows(values: Tensor) -> Tensor:
            return pad(values, (0, 0, first, after))

        def places(values: Tensor) -> Tensor:
            return pad(values, (0, 0, 0, 0, first, after), value=math.nan)

        return replace(
            self, residual=rows(self.residual), square=rows(self.square), mask=rows(self.mask),
            weights=rows(self.weights),
            points=None if self.points is None else places(self.points),
            targets=None if self.targets is None else places(self.targets),
            aim=None if self.aim is None else replace(self.aim, values=places(self.aim.values)),
        )  # fmt: skip

    @property
    def joints(self) -> tuple[str | None, ...]:
        """The joint that each of the n entries is about, or None."""
        names = self.owners or self.labels or (None,) * len(self.sizes)
        return tuple(name if name in self.skeleton.names else None for name in names)


@dataclass(frozen=True)
class Assessed:
    """All that a solver asks of goals at a motion.

    Attributes:
        rows: for least squares, a block for each term (`Term.block`).
        cost: of every sample.
        met: whether every term is within its tolerance.
    """

    rows: list[Float[Tensor, "*b _F _k"]]
    cost: Float[Tensor, "*b"]
    met: Bool[Tensor, "*b"]


@dataclass(frozen=True)
class Term:
    """A goal with parameters, weight, tolerance, times, kernel and reduction.

    Attributes:
        goal: name of a registered goal, or its decorated function.
        parameters: the goal's own, converted and checked; `at` and `weights` may be given here too.
        weight: multiplies the goal's own scale; 0 equals absent.
        tolerance: worst residual that counts as met, in the goal's unit; by default the goal's.
        at: only at the frames nearest to these times (s, task clock). Handed to goals that declare it.
        weights: factor on the cost at each time of `at`. Handed to goals that declare it.
        window: only from the first to the second time (s, task clock), both included.
        sometime: at one frame only, of those between the first and the second time (s): the one where least is amiss,
            each sample's own. So the time is solved for along with the motion.
        kernel, reduction: by default the goal's, which are those of its paper.
        delta: where `huber` turns linear and `geman_mcclure` flat, in the goal's unit.
        name: name in reports and errors, by default the goal's.
        folder: where relative file names are looked for.
    """

    goal: str | Callable[..., Any]
    parameters: Mapping[str, Any] = field(default_factory=dict)
    weight: Number = 1.0
    tolerance: Number | None = None
    at: Number | Sequence[Number] | None = None
    weights: Sequence[Number] | None = None
    window: Sequence[Number] | None = None
    sometime: Sequence[Number] | None = None
    kernel: str | None = None
    reduction: str | None = None
    delta: Number | None = None
    name: str = ""
    folder: InitVar[Path | None] = None

    def __post_init__(self, folder: Path | None) -> None:
        spec = get_goal(self.goal)
        keep = self.__dict__.__setitem__  # the dataclass is frozen from here on
        keep("goal", spec.name)
        keep("name", self.name or spec.name)
        given = dict(self.parameters)
        for key in ("at", "weights"):  # one meaning wherever they are written
            if given.get(key) is not None:
                keep(key, given[key])
            given.pop(key, None)
        for key, value in _options(self.label, {key: getattr(self, key) for key in OPTIONS}).items():
            keep(key, value)
        for key in ("at", "weights"):
            value = getattr(self, key)
            keep(key, (value,) if isinstance(value, float) else value)
            if value is not None and key in spec.parameters:
                given[key] = list(getattr(self, key))
        keep("parameters", spec.validate(given, folder, self.label))
        loose = self.weights is not None and "weights" not in spec.parameters
        if loose and len(self.weights or ()) != len(self.times):
            raise UserError(f"{self.label}: 'weights' needs one number for each time of 'at'")
        for key, span in (("window", self.window), ("sometime", self.sometime)):
            if span is not None and span[1] < span[0]:
                raise UserError(f"{self.label}: '{key}' must be [begin, end], not {list(span)}")
        if self.sometime is not None and (self.at is not None or self.window is not None):
            raise UserError(f"{self.label}: 'sometime' finds the time itself; leave out 'at' and 'window'")

    @classmethod
    def from_table(cls, table: Mapping[str, Any], folder: Path | None = None) -> Term:
        """A term from a [[goal]] table of a task file: `use`, the keys of a term, and the goal's own parameters."""
        if "use" not in table:
            raise UserError("a goal table needs 'use' with the name of a goal, such as use = \"joint_target\"")
        if not isinstance(table["use"], str):
            raise UserError(f"'use' must be the name of a goal, not {shown(table['use'])}")
        own = _options(
            f"goal '{table['use']}'", {key: table[key] for key in TERM_KEYS if key in table and key != "use"}
        )
        rest = {key: value for key, value in table.items() if key not in TERM_KEYS}
        return cls(table["use"], rest, **own, folder=folder)

    @property
    def spec(self) -> GoalSpec:
        """The goal."""
        return get_goal(self.goal)

    @property
    def times(self) -> tuple[float, ...]:
        """The times of `at`, seconds; empty where every frame counts."""
        return cast(tuple[float, ...], self.at or ())

    @property
    def allowed(self) -> float:
        """Worst residual that counts as met, in the goal's unit: the tolerance, or else the goal's."""
        return self.spec.tolerance if self.tolerance is None else self.tolerance

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints that the term was told to be about (its goal's parameter `joint`); empty where it is told none."""
        stated = self.spec.parameters.get(JOINT)
        named = self.parameters.get(JOINT, () if stated is None or stated.required else stated.default)
        return (named,) if isinstance(named, str) else tuple(named or ())

    def loosened(self, reach: float) -> Term:
        """The same, counting as met within `reach` (m) of what it pulls towards, or the angle that counts as much.

        Unchanged where it pulls nowhere.
        """
        reach *= self.spec.metre
        if not self.spec.pulls or self.spec.unit not in A_METRE or self.allowed >= reach:
            return self
        return replace(self, tolerance=reach)

    def moved(self, by: Place) -> Term:
        """The same where everything lies so much (m) further: all coordinates that it states or its goal assumes."""
        spec = self.spec.parameters
        stated = {name: p.default for name, p in spec.items() if not p.required and p.default is not None}
        further = {}
        for name, value in {**stated, **self.parameters}.items():
            try:
                further[name] = moved(spec[name].hint, value, by)
            except UserError as error:
                raise UserError(f"{self.label}: parameter '{name}': {error}") from error
        return replace(self, parameters=further)

    def during(self, begin: float, end: float) -> Term:
        """The same of a part of a motion, from `begin` to `end` (s): its times count from there on.

        What it states no time for holds in that part alone.
        """
        spec = self.spec.parameters
        stated = {name: p.default for name, p in spec.items() if not p.required and p.default is not None}
        stated |= {name: value for name, value in self.parameters.items() if name not in ("at", "weights")}
        moved = {name: value for name, old in stated.items() if (value := later(spec[name].hint, old, begin)) != old}
        further = {name: value for name, value in self.parameters.items() if name in stated} | moved
        at = None if self.at is None else tuple(time + begin for time in self.times)
        window, sometime = (None if s is None else (s[0] + begin, s[1] + begin) for s in (self.window, self.sometime))
        if at is None and window is None and sometime is None:
            window = (begin, end)
        return replace(self, parameters=further, at=at, window=window, sometime=sometime)

    @property
    def exemptions(self) -> tuple[tuple[tuple[str, ...], tuple[tuple[float, float], ...] | None], ...]:
        """What the term was told to let touch the scene (its goal's `exempt`, `exempt_windows` and `touches`).

        Joints (none: the whole body), and the windows (s) in which they may (None: always), each.
        """
        joints, windows, touches = (self.parameters.get(name) for name in EXEMPT)
        found: list[tuple[tuple[str, ...], tuple[tuple[float, float], ...] | None]]
        found = [((joint,), tuple(when)) for joint, when in (touches or {}).items()]
        if joints or windows is not None:
            named = (joints,) if isinstance(joints, str) else tuple(joints or ())
            found.append((named, None if windows is None else tuple(windows)))
        return tuple(found)

    @property
    def support(self) -> tuple[tuple[str, ...], tuple[float, float] | None] | None:
        """Joints whose part of the body rests on something, and from when to when (s; None: always); None for none."""
        if self.spec.supports is None:
            return None
        span = self.window or self.sometime
        times = (min(self.times), max(self.times)) if self.times else None
        return tuple(self.spec.supports(self.parameters)), times if span is None else (span[0], span[1])

    @property
    def label(self) -> str:
        """How errors name the term: with its goal where that is not its name."""
        return f"goal '{self.name}'" if self.name == self.goal else f"goal '{self.name}' ({self.goal})"

    def evaluate(self, motion: Motion, context: Context) -> Evaluated:
        """Residual, mask and weights; raises UserError naming the term when the goal cannot be evaluated.

        A goal that looks at single moments is shown those that it may apply at, and not all of a long motion.
        """
        motion = self._readable(motion)
        span = self._applies(motion)
        if span is None:
            return self._evaluated(motion, context)
        part = slice(*span)
        joints, valid = motion.joints[..., part, :, :], motion.valid[..., part]
        shown = replace(motion, joints=joints, valid=valid, t0=motion.t0 + span[0] / motion.fps)
        return self._evaluated(shown, context).spread(span[0], motion.frames)

    def _applies(self, motion: Motion) -> tuple[int, int] | None:
        """First and last frame (less 1) that a local goal may apply at, with those that it looks at beside them."""
        stated = [*self.times, *(self.window or ()), *(self.sometime or ())]
        if not self.spec.local or not stated:
            return None
        first = math.floor((min(stated) - motion.t0) * motion.fps) - BESIDE
        last = math.ceil((max(stated) - motion.t0) * motion.fps) + BESIDE + 1
        first, last = max(first, 0), min(last, motion.frames)
        return (first, last) if first < last and last - first < WORTH * motion.frames else None

    def _evaluated(self, motion: Motion, context: Context) -> Evaluated:
        """The same of all that is shown."""
        try:
            raw = self.spec.function(motion, context, **self.parameters)
        except UserError as error:
            raise UserError(f"{self.label}: {error}") from error
        result = raw if isinstance(raw, Masked) else Masked(raw)
        residual, sizes = result.residual, self._sizes(result, motion)
        mask = self._spread(result.active, residual, len(sizes), "active") & motion.valid[..., None]
        weights = self._spread(result.weights, residual, len(sizes), "weights").to(residual.dtype)
        chosen = self._chosen(motion).to(residual.dtype)
        mask, weights = mask & (chosen > 0)[:, None], weights * chosen[:, None]
        if self.sometime is not None:
            mask = mask & _best_frame(_squares(residual.detach(), sizes) * weights, mask)[..., None]
        residual = torch.where(_per_component(mask, sizes), residual, 0.0)
        labels, points, targets = self._about(result, motion, len(sizes))
        aim = None if result.aim is None else replace(result.aim, values=result.aim.values.detach())
        return Evaluated(
            residual, _squares(residual, sizes), mask, weights, sizes, labels, points, targets, aim,
            result.marks, motion.skeleton, tuple(result.joints),
        )  # fmt: skip

    def marks(self, motion: Motion, context: Context) -> list[Mark]:
        """What there is to see of the term beside one motion ``[T, J, 3]``: what its goal says, or else its targets.

        Of a goal that says neither, the points and tracks among its parameters, and arrows where joints shall turn. No
        distance of the scene is asked.
        """
        with torch.no_grad():
            return self.marks_of(self.evaluate(motion, context.unbaked))

    def marks_of(self, found: Evaluated, frames: slice = slice(None)) -> list[Mark]:
        """What there is to see of the term as it was evaluated beside one motion; of its targets, those at `frames`."""
        if found.marks is not None:
            return list(found.marks())
        near = self.allowed if self.spec.unit == "m" else 0.0
        points = None if found.points is None else found.points[frames]
        if found.targets is None:
            seen = marks_of_parameters(self.parameters, near)
            if found.aim is not None and points is not None:
                directions = pointed(found.aim, found.joints, found.skeleton)[frames]
                seen += marks_of_aims(directions, points, found.mask[frames])
            return seen
        return marks_of_targets(found.targets[frames], points, found.mask[frames], near)

    def residual(self, motion: Motion, context: Context) -> Float[Tensor, "*b T k"]:
        """The goal's residual in natural units, unweighted; zero where the term does not apply."""
        return self.evaluate(motion, context).residual

    def cost(self, motion: Motion, context: Context) -> Float[Tensor, "*b"]:
        """Cost of every sample: weight x scale x the sum or mean of the kernel over active valid entries."""
        return self._cost(self.evaluate(motion, context))

    def met(self, motion: Motion, context: Context) -> Bool[Tensor, "*b"]:
        """Which samples have every active entry within the tolerance, and one at least."""
        return self._met(self.evaluate(motion, context))

    def judge(self, motion: Motion, context: Context) -> tuple[Float[Tensor, "*b"], Bool[Tensor, "*b"]]:
        """`cost` and `met` of one evaluation."""
        found = self.evaluate(motion, context)
        return self._cost(found), self._met(found)

    def assess(self, motion: Motion, context: Context) -> Assessed:
        """`block`, `cost` and `met` of one evaluation, the last two without a gradient."""
        found = self.evaluate(motion, context)
        with torch.no_grad():
            cost, met = self._cost(found), self._met(found)
        return Assessed([self._block(found)], cost, met)

    def _cost(self, found: Evaluated) -> Float[Tensor, "*b"]:
        costs = kernel_cost(self._kernel, found.square, self._delta) * found.weights * found.mask
        return costs.sum((-2, -1)) * self._factor(found)

    def _met(self, found: Evaluated) -> Bool[Tensor, "*b"]:
        # Written so that what is not a number never passes.
        within_tolerance = (found.square.detach().sqrt() <= self.allowed) | ~found.mask
        return within_tolerance.flatten(-2).all(-1) & found.mask.flatten(-2).any(-1)

    def block(self, motion: Motion, context: Context) -> Float[Tensor, "*b F k"]:
        """Rows for least squares over the F frames at which some sample is active; one frame for `sometime`.

        For the kernel `squared` the sum of the squares is the cost. For the others the weights are those
        of iteratively reweighted least squares (`kernels.least_squares_weight`), constants to autograd: the
        gradient of the sum of squares is the gradient of the cost, its value is not the cost.
        """
        return self._block(self.evaluate(motion, context))

    def _block(self, found: Evaluated) -> Float[Tensor, "*b F k"]:
        per_entry = least_squares_weight(self._kernel, found.square, self._delta) * found.weights
        per_entry = (per_entry * self._factor(found)[..., None, None]).sqrt()
        rows = found.residual * _per_component(per_entry, found.sizes)
        active = found.mask.any(-1)
        if self.sometime is not None:  # every sample's own frame, so that there are as many rows at every value
            frame = active.int().argmax(-1)[..., None, None].expand(*active.shape[:-1], 1, rows.shape[-1])
            return rows.gather(-2, frame)
        return rows[..., active.reshape(-1, active.shape[-1]).any(0), :]

    def report(self, motion: Motion, context: Context) -> list[TermReport]:
        """One row for each sample (a motion without batch axes is one sample)."""
        with torch.no_grad():
            found = self.evaluate(motion, context)
            totals = self._cost(found).reshape(-1)
            entries = len(found.sizes)
            sizes = found.square.sqrt().reshape(-1, motion.frames, entries)
            masks = found.mask.reshape(-1, motion.frames, entries)
            points = None if found.points is None else found.points.reshape(-1, motion.frames, entries, 3)
        return [
            self._row(sizes[s], masks[s], float(totals[s]), found, None if points is None else points[s], motion)
            for s in range(len(totals))
        ]

    def _row(
        self,
        size: Float[Tensor, "T n"],
        mask: Bool[Tensor, "T n"],
        cost: float,
        found: Evaluated,
        points: Float[Tensor, "T n 3"] | None,
        motion: Motion,
    ) -> TermReport:
        name, unit = str(self.goal), self.spec.unit
        # What is not a number is the worst there is: it must never pass as met.
        ranked = torch.where(mask, size.nan_to_num(nan=torch.inf), -1.0)
        series = [value if value >= 0 else None for value in ranked.amax(-1).tolist()]
        empty = TermReport(
            self.name, name, unit, math.nan, math.nan, self.allowed, met=False, cost=cost, weight=self.weight,
            series=tuple(series),
        )  # fmt: skip
        if not mask.any():
            return empty
        frame, entry = divmod(int(ranked.argmax()), size.shape[-1])
        worst = float(size[frame, entry])
        position = None
        if points is not None:
            x, y, z = points[frame, entry].tolist()
            position = (x, y, z)
        return replace(
            empty,
            worst=worst,
            mean=float(size[mask].mean()),
            met=worst <= self.allowed,
            when=motion.t0 + frame / motion.fps,
            where=found.labels[entry] if found.labels else None,
            position=position,
            active_frames=int(mask.any(-1).sum()),
        )

    @property
    def _kernel(self) -> Kernel:
        return cast(Kernel, self.kernel or self.spec.kernel)

    @property
    def _delta(self) -> float:
        return self.spec.delta if self.delta is None else self.delta

    def _factor(self, found: Evaluated) -> Float[Tensor, "*b"]:
        """Weight x scale, divided by the number of active (frame, entry) pairs where the term averages."""
        factor = found.residual.new_full(found.mask.shape[:-2], self.weight * self.spec.scale)
        if (self.reduction or self.spec.reduction) == "mean":
            factor = factor / found.mask.sum((-2, -1)).clamp_min(1)
        return factor

    def _readable(self, motion: Motion) -> Motion:
        """The motion as the goal sees it: padding zeroed, so that nothing in it (not even nan) can leak out.

        A goal that declares `include_padding` and is told so gets every frame as a valid one instead.
        """
        if self.parameters.get("include_padding"):
            return replace(motion, valid=torch.ones_like(motion.valid))
        if bool(motion.valid.all()):
            return motion
        return replace(motion, joints=torch.where(motion.valid[..., None, None], motion.joints, 0.0))

    def _chosen(self, motion: Motion) -> Float[Tensor, " T"]:
        """Weight of every frame by `window` and, where the goal does not handle it itself, `at`."""
        chosen = torch.ones(motion.frames, dtype=motion.joints.dtype, device=motion.joints.device)
        if (span := self.window or self.sometime) is not None:
            chosen = chosen * within(motion, (span[0], span[1]))
        if self.at is not None and "at" not in self.spec.parameters:
            factors = self.weights or (1.0,) * len(self.times)
            at = torch.zeros_like(chosen)
            for frame, factor in zip(frames_near(motion, list(self.times)), factors, strict=True):
                if frame is not None:
                    at[frame] += factor
            chosen = chosen * at
        return chosen

    def _sizes(self, result: Masked, motion: Motion) -> tuple[int, ...]:
        shape, expected = tuple(result.residual.shape), tuple(motion.valid.shape)
        if shape[:-1] != expected or not shape:
            raise UserError(f"{self.label}: its function returned shape {shape}, expected {[*expected, 'k']}")
        sizes = result.sizes if result.sizes is not None else self.spec.dim
        if isinstance(sizes, int):
            sizes = (sizes,) * (shape[-1] // sizes)
        if sum(sizes) != shape[-1]:
            raise UserError(f"{self.label}: its {shape[-1]} components do not divide into entries of {sizes}")
        return sizes

    def _spread(self, given: Tensor | None, residual: Tensor, entries: int, what: str) -> Tensor:
        """`[T]`, `[*b, T]` or `[*b, T, n]` as `[*b, T, n]`."""
        full = (*residual.shape[:-1], entries)
        if given is None:
            return torch.ones(full, dtype=torch.bool, device=residual.device)
        aligned = given if given.ndim == residual.ndim else given[..., None]
        try:
            return aligned.expand(full)
        except RuntimeError as error:
            shape = tuple(given.shape)
            raise UserError(f"{self.label}: '{what}' has shape {shape}, expected [T], [*b, T] or {full}") from error

    def _about(
        self, result: Masked, motion: Motion, entries: int
    ) -> tuple[tuple[str, ...], Tensor | None, Tensor | None]:
        """Labels, points and targets of the entries; a goal about one `joint` need not state its own."""
        labels, points, targets = tuple(result.labels), result.points, result.targets
        if entries == 1 and points is None and not labels and len(self.joints) == 1:
            labels, points = self.joints, motion.joint(self.joints[0])[..., None, :]
        stated = {"labels": labels, "joints": result.joints}
        counts = {what: len(names) for what, names in stated.items() if names}
        aims = None if result.aim is None else result.aim.values
        given = (("points", points), ("targets", targets), ("aims", aims))
        counts |= {what: p.shape[-2] for what, p in given if p is not None}
        for what, count in counts.items():
            if count != entries:
                raise UserError(f"{self.label}: its {what} must be as many as its {entries} entries")
        return labels, None if points is None else points.detach(), None if targets is None else targets.detach()


OPTIONS: dict[str, Any] = {
    "weight": NotNegative,
    "tolerance": NotNegative | None,
    "at": float | tuple[float, ...] | None,
    "weights": tuple[NotNegative, ...] | None,
    "window": tuple[float, float] | None,
    "sometime": tuple[float, float] | None,
    "kernel": Kernel | None,
    "reduction": Reduction | None,
    "delta": Positive | None,
    "name": str,
}
"""Types of the keys of a term that are not its goal's."""


def _options(label: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of a term converted to their types; raises UserError for one that does not fit."""
    return {key: parse(f"{label}: '{key}'", OPTIONS[key], value) for key, value in given.items()}


def _per_component(per_entry: Shaped[Tensor, "*b T n"], sizes: tuple[int, ...]) -> Shaped[Tensor, "*b T k"]:
    """What holds for each entry, stated for each of its components."""
    if len(set(sizes)) == 1:
        return per_entry[..., None].expand(*per_entry.shape, sizes[0]).flatten(-2)
    return per_entry.repeat_interleave(torch.tensor(sizes, device=per_entry.device), dim=-1)


def _best_frame(badness: Float[Tensor, "*b T n"], mask: Bool[Tensor, "*b T n"]) -> Bool[Tensor, "*b T"]:
    """The frame of every sample at which the entries that apply are least amiss, as a mask."""
    total = (badness * mask).sum(-1).nan_to_num(nan=torch.inf)
    best = torch.where(mask.any(-1), total, torch.inf).argmin(-1)
    return torch.nn.functional.one_hot(best, mask.shape[-2]).bool()


def _squares(residual: Float[Tensor, "*b T k"], sizes: tuple[int, ...]) -> Float[Tensor, "*b T n"]:
    if len(set(sizes)) == 1:
        return residual.unflatten(-1, (len(sizes), sizes[0])).square().sum(-1)
    return torch.stack([part.square().sum(-1) for part in residual.split(sizes, dim=-1)], dim=-1)
