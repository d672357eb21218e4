"""Keeping a body a body where goals can't be met: without this, targets out of reach stretch limbs and lift feet.

The paper's failure cases (its Fig. 10) come from solving harder than a body can. What is done where a search ended in
a strained body depends on how far from the goals a body stays:

- Where the goals were met at a small strain, a search goes on from there with a cost on bones, joint limits, jerks,
  skating and shuffling, feet that stood held down, and goals that pull harder; then with the goals alone, if a body
  bears it.
- Otherwise refinement begins again from the generator's own value, with the same costs and goals that pull (targets)
  pulling no harder however far they are (Huber). Where that ends near all targets, as above.
- From elsewhere what is hopeless is let go of (Geman and McClure's kernel, whose pull fades with distance), while what
  is near pulls the harder, still with the body's costs. At last the goals alone are solved for, with all targets, or
  else without those that are still far off, whichever a body bears.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from objectives import Assessed, Context, Objective, Term
from objectives.kernels import Kernel
from objectives.library.scene import foot_heights
from scenectl.control.settings import SolverSettings
from scenectl.measures.metrics import FEET
from scenes.motion.motion import Motion

STRETCH, TORN = 0.005, 0.02
"""Metres by which bones may be further from their lengths than before: in the mean, and in that of any one frame."""
LIFT = 0.03
"""Metres by which a foot that stood may be lifted."""
SOLVED = 1e-3
"""Share of the goals' cost that refinement leaves at most where all is as good as met."""


class Leniency(NamedTuple):
    """By how many times what is borne may be wider, of bones and of feet."""

    bones: float
    feet: float


STRICT, LENIENT, HOPEFUL = Leniency(1.0, 1.0), Leniency(3.0, 1.0), Leniency(4.0, 10.0)
"""What a body bears; what for goals that are met; and from where a body may still be talked into meeting them."""
_LED = 0.2
"""Where goals lead a body along this share of its way or more (a path, a track), its steps fall at other times than
before, and letting go of what is far off would let go of the way: such goals are left to the solver, which minds
bones and shuffling meanwhile where there are walls, too."""
_STANDING, _STILL = 0.07, 0.02
"""A foot stands where it is lower than this over the scene (m) and moves by less than that from frame to frame."""
_HELD = 0.05
"""Metres beyond which a target pulls no harder."""
FAR, OFF = 0.3, 0.03
"""Metres beyond which a target pulls less and less: first only what is hopeless is let go of, then what is missed."""
_NEAR, _INSISTENCE = 0.15, 20.0
"""Metres from targets at which a body's costs may only be holding it up, and by how much more targets count then."""
_APPROACH, _FINISH = 40, 20
"""Iterations at most of the approach, and of what is solved for from there."""
_WALKING = (
    Term("bone_length", weight=10.0, tolerance=0.05),
    Term("foot_clearance", weight=5.0, tolerance=1.0),  # never a reason to go on
)
"""What a body minds beside walls and goals that lead it."""
_BODY = (
    Term("bone_length", weight=60.0),
    Term("joint_limits", weight=20.0),
    Term("smoothness", weight=20.0),
    # The faster a foot, the less it is held: it swings.
    Term("foot_skating", weight=10.0, kernel="geman_mcclure", delta=1.0),
    Term("foot_clearance", weight=3.0),
)
"""What a body minds."""
_FOOT, _FIRM_FOOT = 2e3, 4e3
"""Cost per squared metre by which a standing foot is lifted, each frame; and where goals pull the harder."""


class Natural:
    """What a body may not do for a goal's sake, beside the motion that a generator made of itself.

    Attributes:
        objective: the goals, with those that pull held back, and what a body minds.
    """

    def __init__(self, objective: Objective, before: Motion, context: Context) -> None:
        self._goals = objective
        self.objective, self._foot = self._with_body("huber", _HELD), _FOOT
        feet = before.select(FEET)
        height = foot_heights(feet, before, context)
        moved = torch.nn.functional.pad(feet.diff(dim=-3).norm(dim=-1), (0, 0, 0, 1))
        self._rest = feet[..., 1] + (-height).clamp(0.0, _STANDING)  # out of the floor is no lift
        free = torch.tensor([foot not in _asked(objective) for foot in FEET])
        self._stands = (height < _STANDING) & (moved < _STILL) & before.valid[..., None] & free
        self._stretched = bone_errors(before)
        self._led = leads(objective, before, context)

    def letting_go(self) -> Natural:
        """Insisting, but with goals that pull less and less where they are further off than `FAR`."""
        other = copy(self)
        other._goals = Objective(_with_kernel(self._goals, "geman_mcclure", FAR))
        return other.insisting()

    def insisting(self) -> Natural:
        """The same with goals that pull the harder, and feet that hold on the harder."""
        other = copy(self)
        pulling = (replace(t, weight=_INSISTENCE * t.weight) if t.spec.pulls else t for t in self._goals.counted)
        other.objective, other._foot = Objective((*pulling, *_BODY)), _FIRM_FOOT
        return other

    def in_reach(self, motion: Motion, context: Context) -> Bool[Tensor, " S"]:
        """Samples whose goals that pull are all nearly met; none where nothing pulls."""
        pulling = tuple(t.loosened(_NEAR) for t in self._goals.counted if t.spec.pulls)
        return Objective(pulling).met(motion, context) & bool(pulling)

    @property
    def without_outliers(self) -> Objective:
        """The goals alone, of which those that pull let go of what is further off than `OFF`."""
        return Objective(_with_kernel(self._goals, "geman_mcclure", OFF))

    def _with_body(self, kernel: Kernel, delta: float) -> Objective:
        return Objective((*_with_kernel(self._goals, kernel, delta), *_BODY))

    @torch.no_grad()
    def strained(self, after: Motion, leniency: Leniency = STRICT) -> Bool[Tensor, " S"]:
        """Samples with longer or shorter bones than before, or with a foot in the air that stood.

        None where goals lead the body along most of its way. A foot that a goal asks for may be lifted. All limits are
        so many times as wide as `leniency` says.
        """
        now, before, lift = bone_errors(after), self._stretched, leniency.feet * LIFT
        if self._led:
            return torch.zeros_like(now[:, 0], dtype=torch.bool)
        stretched = now.mean(-1) > before.mean(-1) + leniency.bones * STRETCH
        torn = now.amax(-1) > before.amax(-1) + leniency.bones * TORN
        return stretched | torn | (self.lift(after) > lift)

    def lift(self, after: Motion) -> Float[Tensor, " S"]:
        """The most (m) by which a foot that stood before is higher now; negative where all are lower."""
        return self._raised(after).amax((-2, -1))

    def met(self, motion: Motion, context: Context) -> Bool[Tensor, " S"]:
        """Which samples have every goal met by a body that isn't strained."""
        return self._goals.met(motion, context) & ~self.strained(motion)

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
        """Rows on standing feet that are lifted."""
        return self._foot**0.5 * self._raised(motion).clamp_min(0.0)

    def _raised(self, motion: Motion) -> Float[Tensor, "S T 2"]:
        """How much higher (m) each foot is than when it stood, or than the floor it stood in; 0 where it didn't."""
        return (motion.select(FEET)[..., 1] - self._rest) * self._stands


def approach(settings: SolverSettings) -> SolverSettings:
    """For the search with a body's costs: many rows, most of them one-sided."""
    fewer = min(settings.iterations, _APPROACH)
    return settings.model_copy(update={"name": "lbfgs", "step": None, "iterations": fewer})


def finish(settings: SolverSettings) -> SolverSettings:
    """For the search without them from where the approach ended, which is short or leads nowhere."""
    return settings.model_copy(update={"iterations": min(settings.iterations, _FINISH)})


def leads(objective: Objective, motion: Motion, context: Context) -> bool:
    """Whether goals that pull have a say at so many of the frames that they lead a body along its way."""

    def share(term: Term) -> float:
        return float(term.evaluate(motion, context).mask.any(-1).float().mean())

    return any(term.spec.pulls and share(term) >= _LED for term in objective.counted)


def minding_walk(objective: Objective) -> Objective:
    """The goals, bones and shuffling; a search that meets the goals goes on while a bone is off by too much."""
    return Objective((*objective.terms, *_WALKING))


def _asked(objective: Objective) -> set[str]:
    """Joints that goals name."""
    named: set[str] = set()
    for term in objective.counted:
        joint = term.parameters.get("joint", ())
        named |= {joint} if isinstance(joint, str) else set(joint)
    return named


def _with_kernel(objective: Objective, kernel: Kernel, delta: float) -> tuple[Term, ...]:
    """The terms, with another kernel for those that pull the harder the further off a target is."""
    return tuple(
        replace(term, kernel=kernel, delta=delta)
        if term.spec.pulls and (term.kernel or term.spec.kernel) == "squared"
        else term
        for term in objective.counted
    )


def bone_errors(motion: Motion) -> Float[Tensor, "*b T"]:
    """Mean distance (m) of each frame's bones from the skeleton's lengths; 0 in padding."""
    return stretches(motion).abs().mean(-1)


def stretches(motion: Motion) -> Float[Tensor, "*b T B"]:
    """By how much (m) each bone is longer than the skeleton's; 0 in padding."""
    parents, children = (list(side) for side in zip(*motion.skeleton.bones, strict=True))
    lengths = (motion.joints[..., children, :] - motion.joints[..., parents, :]).norm(dim=-1)
    rest = lengths.new_tensor(motion.skeleton.bone_lengths)[children]
    return (lengths - rest) * motion.valid[..., None]
