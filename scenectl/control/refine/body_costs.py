"""What a body is held to where goals would lift it: without it, targets out of reach are met by flying there.

The paper's failure cases (its Fig. 10) come from goals that outweigh everything else. Bones are rigid by construction
(`scenes.motion.rigid`), and so what gives is the ground. Where a search for the goals lifts a foot that stood before or
pushes one into the ground, another goes on from there if the goals were met and it is not far off, and otherwise begins
again from the generator's own value: with feet held to the ground, costs on joint limits, jerks, skating and shuffling,
and goals that pull (targets) under Geman and McClure's kernel, whose pull fades with distance. At last the goals alone
are solved for, without those that are still far off, which is kept where feet stay on the ground.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from objectives import Assessed, Context, Objective, Term
from objectives.library.scene import foot_heights
from scenectl.control.settings import SolverSettings
from scenectl.control.thresholds import THRESHOLDS, Thresholds
from scenes.motion.motion import Motion
from scenes.motion.skeleton import FEET

_NEVER = 1e6
"""Tolerance, in any unit, of costs that are never a reason to go on."""


@dataclass(frozen=True)
class BodyCosts:
    """Goals and a body's costs, beside the motion that a generator made of itself (`beside`).

    Attributes:
        goals: without costs of a body.
        objective: the goals, with more weight on those that pull, which fades with distance, and costs of a body.
        rest: heights (m) of feet before, ``[S, T, 2]``, out of the floor where they were in it.
        stands: which of them stood, and may not be lifted.
        low: heights (m) over the ground that feet may go down to: 0, or where they were before.
        thresholds: see there.
    """

    goals: Objective
    objective: Objective
    rest: Float[Tensor, "S T 2"]
    stands: Bool[Tensor, "S T 2"]
    low: Float[Tensor, "S T 2"]
    thresholds: Thresholds = THRESHOLDS

    @classmethod
    def beside(
        cls, before: Motion, goals: Objective, context: Context, thresholds: Thresholds = THRESHOLDS
    ) -> BodyCosts:
        """Of the goals in a context, and of a body that moved like this before."""
        feet, standing = before.select(FEET), thresholds.standing
        height = foot_heights(feet, before, context)
        moved = torch.nn.functional.pad(feet.diff(dim=-3).norm(dim=-1), (0, 0, 0, 1))
        rest = feet[..., 1] + (-height).clamp(0.0, standing)  # out of the floor is no lift
        named = {joint for term in goals.counted for joint in term.joints}
        free = torch.tensor([foot not in named for foot in FEET], device=feet.device)
        stands = (height < standing) & (moved < thresholds.still) & before.valid[..., None] & free
        low = torch.where(before.valid[..., None], height.clamp_max(0.0), -torch.inf)
        pulling = _fading(goals, thresholds.far, thresholds.pull)
        return cls(goals, Objective((*pulling, *_body(thresholds))), rest, stands, low, thresholds)

    @property
    def without_outliers(self) -> Objective:
        """The goals alone, of which those that pull fade where they are further off than `off`."""
        return Objective(_fading(self.goals, self.thresholds.off))

    @torch.no_grad()
    def off_ground(self, after: Motion, context: Context, factor: float = 1.0) -> Bool[Tensor, " S"]:
        """Samples with a foot in the air that stood, unless a goal names it, or with one in the ground that wasn't.

        Both by more than `lift` times the factor.
        """
        return self._off(after, context).amax((-2, -1)) > factor * self.thresholds.lift

    def lift(self, after: Motion) -> Float[Tensor, " S"]:
        """The most (m) by which a foot that stood before is higher now; negative where all are lower."""
        return self._raised(after).amax((-2, -1))

    def met(self, motion: Motion, context: Context) -> Bool[Tensor, " S"]:
        """Which samples have every goal met by a body on its feet."""
        return self.goals.met(motion, context) & ~self.off_ground(motion, context)

    def judge(self, motion: Motion, context: Context) -> tuple[Float[Tensor, " S"], Bool[Tensor, " S"]]:
        """Costs of goals and body, differentiable in the motion's joints, and what is `met`."""
        cost, _ = self.objective.judge(motion, context)
        return cost + self._footing(motion, context).square().sum((-2, -1)), self.met(motion, context)

    def assess(self, motion: Motion, context: Context) -> Assessed:
        """Goals and body as least squares; met where the goals are and the body is on its feet."""
        found, feet = self.objective.assess(motion, context), self._footing(motion, context)
        with torch.no_grad():
            cost = found.cost + feet.square().sum((-2, -1))
        return Assessed([*found.rows, feet], cost, self.met(motion, context))

    def _footing(self, motion: Motion, context: Context) -> Float[Tensor, "S T 2"]:
        """Rows on feet that are off the ground."""
        return self.thresholds.foot**0.5 * self._off(motion, context)

    def _off(self, motion: Motion, context: Context) -> Float[Tensor, "S T 2"]:
        """How far (m) each foot is lifted, or pushed into the ground."""
        sunk = self.low - foot_heights(motion.select(FEET), motion, context)
        return self._raised(motion).clamp_min(0.0) + sunk.clamp_min(0.0)

    def _raised(self, motion: Motion) -> Float[Tensor, "S T 2"]:
        """How much higher (m) each foot is than when it stood, or than the floor it stood in; 0 where it didn't."""
        return (motion.select(FEET)[..., 1] - self.rest) * self.stands


def approach(settings: SolverSettings, thresholds: Thresholds) -> SolverSettings:
    """For searches with a body's costs: many rows, most of them one-sided."""
    fewer = min(settings.iterations, thresholds.approach)
    return settings.model_copy(update={"name": "lbfgs", "step": None, "iterations": fewer})


def finish(settings: SolverSettings, thresholds: Thresholds) -> SolverSettings:
    """For searches without them from where such a search ended, which are short or lead nowhere."""
    return settings.model_copy(update={"iterations": min(settings.iterations, thresholds.finish)})


def leads(objective: Objective, motion: Motion, context: Context, led: float = THRESHOLDS.led) -> bool:
    """Whether goals that draw apply at so many of the frames that they lead a body along its way (a path, a track).

    Steps fall at other times there than before, and fading what is far off would fade the way itself.
    """

    def share(term: Term) -> float:
        return float(term.evaluate(motion, context).mask.any(-1).float().mean())

    return any(term.spec.draws and share(term) >= led for term in objective.counted)


@cache
def walk_costs(level: bool = True, thresholds: Thresholds = THRESHOLDS) -> tuple[Term, ...]:
    """Low swings and sliding, for walks that are led past walls.

    Over steps a foot on its way is as near to the next one as a foot that carries, so sliding counts on `level` ground.
    """
    carrying = {"each": False, "height": thresholds.carries, "allowed": thresholds.slide}
    clearance = Term("foot_clearance", weight=thresholds.led_clearance, tolerance=_NEVER)
    skating = Term("foot_skating", carrying, weight=thresholds.led_skating, tolerance=_NEVER)
    return (clearance, skating) if level else (clearance,)


@cache
def pose_costs(thresholds: Thresholds = THRESHOLDS) -> tuple[Term, ...]:
    """Jerks, sliding, and hanging over the ground, for bodies that are brought into poses in joints.

    Poses relative to the pelvis leave open how high it is. Recorded flights outweigh the cost of hanging.
    """
    contact = {"weight": thresholds.hanging, "kernel": "squared", "reduction": "sum", "tolerance": _NEVER}
    return (
        Term("smoothness", weight=thresholds.posed_smooth, tolerance=_NEVER),
        Term("foot_skating", **_skating(thresholds), tolerance=_NEVER),
        Term("foot_contact", {"threshold": thresholds.hangs}, **contact),  # type: ignore[arg-type]
    )


def _skating(thresholds: Thresholds) -> dict[str, Any]:
    return {"weight": thresholds.skating, "kernel": "geman_mcclure", "delta": thresholds.swing}


@cache
def _body(thresholds: Thresholds) -> tuple[Term, ...]:
    return (
        Term("joint_limits", weight=thresholds.limits),
        Term("smoothness", weight=thresholds.smooth),
        Term("foot_skating", **_skating(thresholds)),
        Term("foot_clearance", weight=thresholds.clearance),
    )


def _fading(objective: Objective, delta: float, pull: float = 1.0) -> tuple[Term, ...]:
    """The terms, with more weight on those that pull, whose pull fades where they are further off than `delta` (m)."""
    return tuple(_faded(replace(t, weight=pull * t.weight), delta) if t.spec.pulls else t for t in objective.counted)


def _faded(term: Term, delta: float) -> Term:
    """With Geman and McClure's kernel instead of that which pulls the harder the further off a target is."""
    square = (term.kernel or term.spec.kernel) == "squared"
    return replace(term, kernel="geman_mcclure", delta=delta * term.spec.metre) if square else term
