"""Settings of guidance and refinement, as they stand in a task file."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from scenes.tables import Table


class GuidanceSettings(Table):
    """How strongly goals tilt a generator's beliefs.

    Attributes:
        scale: multiplies the goals' log-likelihood in guidance (1 is Eq. 10); 0 switches guidance off.
    """

    scale: float = Field(default=1.0, ge=0)


class SolverSettings(Table):
    """How refinement searches (Eq. 12).

    Attributes:
        name: "auto" (default) takes what fits the goals at the step's prices: "lm" (Levenberg-Marquardt in dual form)
            for few equations and few walls, "gauss_newton" (by conjugate gradients) for many equations, "lbfgs" for
            many equations and walls, or where products are dear; "lm" goes on as "lbfgs" where walls wake by the
            dozen, with the steps that are left. Or "adam", or "gradient": the paper's ascent with a constant step.
        iterations: at most this many steps (a tenth where "auto" takes Gauss-Newton, whose steps take many
            passes each); 0 switches refinement off.
        step: step size; by default 0.05 for Adam and the paper's 0.01 for gradient ascent. L-BFGS finds its own.
        least: steps that are made though goals are met before, for costs that are never met; walks that are led past
            walls have a few of their own.
        prior: pull towards where a search begins, in cost per squared distance, of which the step states the unit
            (`Step.unit`): keeps what goals leave free as the generator made it.
        patience: steps in a row that decrease the cost by less than `progress` after which the search ends.
        progress: relative decrease of the cost that counts as progress.
        enough: samples of a batch that meet all goals after which the others are abandoned; by default none is. Set it
            to 1 where only the best of several samples is wanted.
        lead: steps at most, at first, in which only goals that pull (targets, paths) count, until they are met,
            where there are others too: walls that count from the start can hold a body on their wrong side.
        natural: where goals lift feet that stood or push them into the ground, refine once more with pulls that fade
            with distance and a cost on both (`scenectl.control.refine.body_costs`); where goals lead a body past walls,
            count feet that shuffle once they have led.
        polish: leave the last centimetre of targets to a smooth move of joints, which needs no decoder
            (`scenectl.control.refine.polish`).
    """

    name: Literal["auto", "lm", "gauss_newton", "lbfgs", "adam", "gradient"] = "auto"
    iterations: int = Field(default=100, ge=0)
    step: float | None = Field(default=None, gt=0)
    least: int = Field(default=0, ge=0)
    prior: float = Field(default=1e-5, ge=0)
    patience: int = Field(default=10, ge=1)
    progress: float = Field(default=1e-4, gt=0)
    enough: int | None = Field(default=None, ge=1)
    lead: int = Field(default=40, ge=0)
    natural: bool = True
    polish: bool = True
