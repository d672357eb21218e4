"""What a body is held to where goals can't be met: without it, targets out of reach stretch limbs and lift feet.

The paper's failure cases (its Fig. 10) come from goals that outweigh everything else. What follows a search that ended
in a strained body depends on how far from the goals it stays once a body's costs are added:

- Where the goals were met at a small strain, a search goes on from there with costs on bones, joint limits, jerks,
  skating and shuffling, feet that stood held down, and more weight on pulling goals; then with the goals alone, which
  is kept where it strains no body.
- Otherwise refinement begins again from the generator's own value, with the same costs and goals that pull (targets)
  under a Huber kernel, so that none pulls harder from further away. Where that ends near all targets, as above.
- Otherwise pulling goals get more weight and Geman and McClure's kernel, whose pull fades with distance, still with the
  body's costs. At last the goals alone are solved for, with all targets, or else without those that are still far off;
  what strains no body is kept.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from objectives import Assessed, Context, Objective, Term
from objectives.kernels import Kernel
from objectives.library.scene import foot_heights
from scenectl.control.settings import SolverSettings
from scenectl.control.thresholds import THRESHOLDS, Thresholds
from scenes.motion.bones import bone_errors
from scenes.motion.motion import Motion
from scenes.motion.skeleton import FEET


@dataclass(frozen=True)
class BodyCosts:
    """Goals and a body's costs, beside the motion that a generator made of itself (`beside`).

    Attributes:
        goals: without costs of a body.
        objective: the goals, under the kernel in use, and costs of a body.
        foot: cost (1/m^2) of lifting a foot that stood, each frame.
        rest: heights (m) of feet before, ``[S, T, 2]``, out of the floor where they were in it.
        stands: which of them stood, and may not be lifted.
        stretched: bone errors (m) before, ``[S, T]``.
        led: whether goals lead the body along its way, which then isn't judged.
        thresholds: see there.
    """

    goals: Objective
    objective: Objective
    foot: float
    rest: Float[Tensor, "S T 2"]
    stands: Bool[Tensor, "S T 2"]
    stretched: Float[Tensor, "S T"]
    led: bool
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
        held = (*_with_kernel(goals, "huber", thresholds.held), *_body(thresholds))
        led, stretched = leads(goals, before, context, thresholds.led), bone_errors(before)
        return cls(goals, Objective(held), thresholds.foot, rest, stands, stretched, led, thresholds)

    def tightened(self) -> BodyCosts:
        """The same with more weight on pulling goals, under their own kernels, and on feet that stood."""
        pull = self.thresholds.pull
        pulling = (replace(t, weight=pull * t.weight) if t.spec.pulls else t for t in self.goals.counted)
        objective = Objective((*pulling, *_body(self.thresholds)))
        return replace(self, objective=objective, foot=self.thresholds.firm_foot)

    def robust(self) -> BodyCosts:
        """Tightened, but with pulling goals whose pull fades where they are further off than `far`."""
        return replace(
            self, goals=Objective(_with_kernel(self.goals, "geman_mcclure", self.thresholds.far))
        ).tightened()

    @property
    def without_outliers(self) -> Objective:
        """The goals alone, of which those that pull fade where they are further off than `off`."""
        return Objective(_with_kernel(self.goals, "geman_mcclure", self.thresholds.off))

    def near(self, motion: Motion, context: Context) -> Bool[Tensor, " S"]:
        """Samples whose pulling goals are all nearly met; none where nothing pulls."""
        pulling = tuple(t.loosened(self.thresholds.near) for t in self.goals.counted if t.spec.pulls)
        return Objective(pulling).met(motion, context) & bool(pulling)

    @torch.no_grad()
    def strained(self, after: Motion, bones: float = 1.0, feet: float = 1.0) -> Bool[Tensor, " S"]:
        """Samples with longer or shorter bones than before, or with a foot in the air that stood.

        None where goals lead the body along most of its way. A foot that a goal names may be lifted. Limits of bones
        and of feet are multiplied by the factors.
        """
        now, before, limit = bone_errors(after), self.stretched, self.thresholds
        if self.led:
            return torch.zeros_like(now[:, 0], dtype=torch.bool)
        stretched = now.mean(-1) > before.mean(-1) + bones * limit.stretch
        torn = now.amax(-1) > before.amax(-1) + bones * limit.torn
        return stretched | torn | (self.lift(after) > feet * limit.lift)

    def lift(self, after: Motion) -> Float[Tensor, " S"]:
        """The most (m) by which a foot that stood before is higher now; negative where all are lower."""
        return self._raised(after).amax((-2, -1))

    def met(self, motion: Motion, context: Context) -> Bool[Tensor, " S"]:
        """Which samples have every goal met by a body that isn't strained."""
        return self.goals.met(motion, context) & ~self.strained(motion)

    def cost(self, motion: Motion, context: Context) -> Float[Tensor, " S"]:
        """Of goals and body; differentiable in the motion's joints."""
        return self.objective.cost(motion, context) + self._footing(motion).square().sum((-2, -1))

    def assess(self, motion: Motion, context: Context) -> Assessed:
        """Goals and body as least squares; met where the goals are and the body isn't strained."""
        found, feet = self.objective.assess(motion, context), self._footing(motion)
        with torch.no_grad():
            cost = found.cost + feet.square().sum((-2, -1))
        return Assessed([*found.rows, feet], cost, self.met(motion, context))

    def _footing(self, motion: Motion) -> Float[Tensor, "S T 2"]:
        """Rows on feet that stood and are lifted."""
        return self.foot**0.5 * self._raised(motion).clamp_min(0.0)

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


def walk_costs(level: bool = True, thresholds: Thresholds = THRESHOLDS) -> tuple[Term, ...]:
    """Bones, low swings and sliding, for walks that are led past walls; bones that are off by too much are not met.

    Over steps a foot on its way is as near to the next one as a foot that carries, so sliding counts on `level` ground.
    """
    never = 100.0  # m, m/s: never a reason to go on
    carrying = {"each": False, "height": thresholds.carries, "allowed": thresholds.slide}
    body = (
        Term("bone_length", weight=thresholds.led_bones, tolerance=thresholds.led_bone_error),
        Term("foot_clearance", weight=thresholds.led_clearance, tolerance=never),
    )
    return (*body, Term("foot_skating", carrying, weight=thresholds.led_skating, tolerance=never)) if level else body


def _body(thresholds: Thresholds) -> tuple[Term, ...]:
    skating = {"weight": thresholds.skating, "kernel": "geman_mcclure", "delta": thresholds.swing}
    return (
        Term("bone_length", weight=thresholds.bones),
        Term("joint_limits", weight=thresholds.limits),
        Term("smoothness", weight=thresholds.smooth),
        Term("foot_skating", **skating),  # type: ignore[arg-type]
        Term("foot_clearance", weight=thresholds.clearance),
    )


def _with_kernel(objective: Objective, kernel: Kernel, delta: float) -> tuple[Term, ...]:
    """The terms, with another kernel (delta in m) for those that pull the harder the further off a target is."""
    return tuple(
        replace(term, kernel=kernel, delta=delta * term.spec.metre)
        if term.spec.pulls and (term.kernel or term.spec.kernel) == "squared"
        else term
        for term in objective.counted
    )
