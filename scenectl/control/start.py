"""Where a motion begins, as an unknown: a rigid move of each sample over the floor, solved for along with its value.

Features state every motion from the origin, and so a target near the start, or a wall around it, may be out of reach of
all motions from one place and easy from another. Generators know nothing of this: a guide moves their steps before it
looks at them, and refinement solves for the moves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from objectives import Context, Objective
from scenectl.control.settings import SolverSettings
from scenectl.control.solvers.choice import minimise
from scenectl.control.solvers.problem import Problem, judged
from scenectl.control.thresholds import THRESHOLDS, Thresholds
from scenectl.generators.base import Step
from scenectl.generators.steps import AroundStep
from scenes.motion.headings import turned
from scenes.motion.motion import Motion

UNKNOWNS = 3
"""A sample's move: x and z (m), and yaw about the vertical through the pivot (rad)."""
_FIT = SolverSettings(name="lbfgs", prior=0.0, patience=3, progress=1e-3)
"""Without a prior: a start is as good anywhere, and all the goals' own."""


@dataclass(frozen=True)
class FreeStart:
    """A start that is solved for.

    Attributes:
        pivot: world point (m) about which motions turn; where the task says that the search begins.
    """

    pivot: tuple[float, float, float]

    def moved(self, motion: Motion, moves: Float[Tensor, "S 3"]) -> Motion:
        """Motions ``[S, T, J, 3]`` turned about the pivot and shifted, each by its own move."""
        return replace(motion, joints=_moved(motion.joints, moves, self.pivot))

    def fit(
        self, motion: Motion, objective: Objective, context: Context, thresholds: Thresholds = THRESHOLDS
    ) -> Float[Tensor, "S 3"]:
        """The moves of least cost for a motion.

        Costs have several valleys in yaw: short searches from several headings for what pulls, all in one batch, of
        which each sample's best by all goals is where a search for all goals begins.
        """
        samples, headings = len(motion.joints), thresholds.headings
        motion = replace(motion, joints=motion.joints.detach())
        joints, valid = motion.joints.repeat(headings, 1, 1, 1), motion.valid.repeat(headings, 1)
        many = replace(motion, joints=joints, valid=valid)
        begin = joints.new_zeros(headings * samples, UNKNOWNS)
        yaws = torch.arange(headings, device=joints.device).repeat_interleave(samples)
        begin[:, -1] = yaws.to(begin) * (2 * torch.pi / headings)

        def least(goals: Objective, still: Motion, begin: Float[Tensor, "R 3"], steps: int) -> Float[Tensor, "R 3"]:
            problem = Problem(judged(lambda moves: goals.cost(self.moved(still, moves), context)), begin)
            return minimise(problem, _FIT.model_copy(update={"iterations": steps}), thresholds).value

        pulling = Objective(tuple(t for t in objective.counted if t.spec.pulls))
        begun = least(pulling if pulling.terms else objective, many, begin, thresholds.heading_steps)
        with torch.no_grad():
            best = objective.cost(self.moved(many, begun), context).unflatten(0, (headings, samples)).argmin(0)
        chosen = begun.unflatten(0, (headings, samples))[best, torch.arange(samples, device=best.device)]
        return least(objective, motion, chosen, thresholds.start_steps)


@dataclass(frozen=True)
class MovedStep(AroundStep):
    """A step whose value ends with its start's moves.

    Attributes:
        value: the inner step's, flat, then the moves, ``[S, n + 3]``.
        inner: the step as its generator made it.
        start: about whose pivot it is moved.
    """

    value: Float[Tensor, "S m"]
    inner: Step
    start: FreeStart

    @classmethod
    def of(cls, inner: Step, start: FreeStart, moves: Float[Tensor, "S 3"]) -> MovedStep:
        return cls(torch.cat([inner.value.detach().flatten(1), moves], dim=1), inner, start)

    @property
    def moves(self) -> Float[Tensor, "S 3"]:
        return self.value[:, -UNKNOWNS:]

    def decode(self, value: Float[Tensor, "S m"]) -> Motion:
        return self.start.moved(self.inner.decode(self._inner(value)), value[:, -UNKNOWNS:])

    def at(self, value: Float[Tensor, "S m"]) -> MovedStep:
        return MovedStep(value, self.inner.at(self._inner(value)), self.start)

    def take(self, samples: Int[Tensor, " s"]) -> MovedStep:
        return MovedStep(self.value[samples], self.inner.take(samples), self.start)

    @property
    def motion(self) -> Motion:
        return self.start.moved(self.inner.motion, self.moves)

    def jvp(self, tangent: Float[Tensor, "S m"]) -> Float[Tensor, "S T J 3"]:
        round_pivot = turned(self.inner.jvp(self._inner(tangent)), self.moves[:, 2, None, None])
        along = tangent[:, -UNKNOWNS:]
        shift = torch.stack([along[:, 0], torch.zeros_like(along[:, 0]), along[:, 1]], dim=-1)
        return round_pivot + shift[:, None, None] + tangent[:, -1, None, None, None] * self._swing()

    def vjp(self, cotangent: Float[Tensor, "S T J 3"]) -> Float[Tensor, "S m"]:
        return self.vjps(cotangent[None])[0]

    def vjps(self, cotangents: Float[Tensor, "R S T J 3"]) -> Float[Tensor, "R S m"]:
        inner = self.inner.vjps(turned(cotangents, -self.moves[:, 2, None, None])).flatten(2)
        shift = cotangents.sum((2, 3))[..., [0, 2]]
        swing = (cotangents * self._swing()).sum((2, 3, 4))
        return torch.cat([inner, shift, swing[..., None]], dim=-1)

    def _inner(self, value: Tensor) -> Tensor:
        return value[:, :-UNKNOWNS].unflatten(1, self.inner.value.shape[1:])

    def _swing(self) -> Float[Tensor, "S T J 3"]:
        """How joints move as the yaw grows: at right angles to their way from the pivot."""
        joints = self.inner.motion.joints
        round_pivot = turned(joints - joints.new_tensor(self.start.pivot), self.moves[:, 2, None, None])
        return torch.stack([round_pivot[..., 2], torch.zeros_like(round_pivot[..., 1]), -round_pivot[..., 0]], dim=-1)


def _moved(
    joints: Float[Tensor, "S T J 3"], moves: Float[Tensor, "S 3"], pivot: tuple[float, float, float]
) -> Float[Tensor, "S T J 3"]:
    centre = joints.new_tensor(pivot)
    shift = torch.stack([moves[:, 0], torch.zeros_like(moves[:, 0]), moves[:, 1]], dim=-1)
    return turned(joints - centre, moves[:, 2, None, None]) + centre + shift[:, None, None]
