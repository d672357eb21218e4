"""The stages of a refinement: a search for all goals, relief of strained bodies, and polishing of joints.

Each is a function of its setting and of what the stage before it found; none changes what it is given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from objectives import Objective
from scenectl.control.refine.body_costs import approach, finish, leads, walk_costs
from scenectl.control.refine.polish import SmoothStep, kept, polishing
from scenectl.control.refine.setting import Setting
from scenectl.control.rise import Rise
from scenectl.control.solvers.problem import Reason, Solution
from scenectl.generators.steps import MappedStep
from scenes.motion.rigid import rigid

Stage = Callable[[Setting, Solution], Solution]


def solved(setting: Setting) -> Solution:
    """The values that meet goals best (Eq. 12), through every stage that the settings ask for."""
    found = search(setting)
    stages: list[Stage] = [relieve] if setting.solver.natural else []
    stages += [polish] if setting.solver.polish else []
    for stage in stages:
        found = stage(setting, found)
    return found.settled(setting.objective.met(setting.motion(found), setting.context))


def search(setting: Setting) -> Solution:
    """All goals, from where those that pull have led; from the generator's own value where that was no help.

    A wall is a hinge: once a body is on the wrong side of it, goals and wall hold each other in balance, and no
    solver gets it out. What leads (a path, a target) lies on the right side, and walls count from there on.
    """
    goals, solver, step = setting.goals, setting.solver, setting.step
    leading = tuple(t for t in goals.counted if t.spec.pulls)
    if not solver.lead or len(leading) in (0, len(goals.counted)):
        return setting.solve(goals)
    walks = solver.natural and leads(goals, step.motion, setting.context, setting.thresholds.led)
    level = Rise.of(goals) is None
    costs = walk_costs(level, setting.thresholds) if walks else ()
    goals = Objective((*goals.terms, *costs)) if costs else goals
    few = {"iterations": min(solver.lead, solver.iterations), "enough": None}
    led = setting.solve(Objective((*leading, *(costs if level else ()))), settings=solver.model_copy(update=few))
    found = setting.solve(goals, led.value)
    found = replace(found, evaluations=found.evaluations + led.evaluations)
    lost = ~(setting.cost(setting.motion(found)) <= setting.cost(step.motion))  # nan, too
    samples = lost.nonzero()[:, 0]
    if not len(samples):
        return found
    return found.merged(setting.of(samples).solve(goals), samples, torch.ones_like(lost[lost]))


def relieve(setting: Setting, found: Solution) -> Solution:
    """Solved anew, with a body's costs, for samples whose body is strained (`scenectl.control.refine.body_costs`)."""
    body, after, limit = setting.body_costs(), setting.motion(found), setting.thresholds
    gone = torch.tensor([reason == "abandoned" for reason in found.reasons], device=found.value.device)
    # What is met, or nearly, stays so even though a bone is a little longer.
    met = setting.goals.met(after, setting.context)
    as_good = met | (setting.cost(after) <= limit.solved * setting.cost(setting.step.motion))
    strained = torch.where(as_good, body.strained(after, limit.met_bones), body.strained(after)) & ~gone
    near = strained & met & ~body.strained(after, limit.near_bones, limit.near_feet)
    if len(samples := near.nonzero()[:, 0]):
        found, helped = _tightened(setting.of(samples), found, found.value[samples], samples)
        strained[samples[helped]] = False
    if len(samples := strained.nonzero()[:, 0]):
        found = _approached(setting.of(samples), found, samples)
    return found


def _approached(setting: Setting, found: Solution, samples: Int[Tensor, " s"]) -> Solution:
    """With a body's costs, from the generator's own values, which the setting holds; then on from what they lead to."""
    body, whole = setting.body_costs(), torch.ones_like(samples, dtype=torch.bool)
    gentle = setting.solve(body, settings=approach(setting.solver, setting.thresholds))
    found, left = found.merged(gentle, samples, whole, "strained"), whole
    if (near := body.near(setting.motion(gentle), setting.context)).any():
        nearer, left = near.nonzero()[:, 0], whole.clone()
        found, helped = _tightened(setting.of(nearer), found, gentle.value[near], samples[near])
        left[near] = ~helped
    if left.any():
        found = _robust(setting.of(left.nonzero()[:, 0]), found, gentle.value[left], samples[left])
    return found


def _tightened(
    setting: Setting, found: Solution, begin: Float[Tensor, "s n"], samples: Int[Tensor, " s"]
) -> tuple[Solution, Bool[Tensor, " s"]]:
    """From near the goals, with a body's costs, and at last without; and which samples it helped."""
    body, solver, limits = setting.body_costs(), setting.solver, setting.thresholds
    held = setting.solve(body.tightened(), begin, approach(solver, limits))
    there = setting.motion(held)
    helped = body.near(there, setting.context) & ~body.strained(there)
    found = found.merged(held, samples, helped, "strained")
    closer = setting.solve(setting.goals, held.value, finish(solver, limits))
    there = setting.motion(closer)
    met = setting.goals.met(there, setting.context) & ~body.strained(there)
    return found.merged(closer, samples, met), helped | met


def _robust(setting: Setting, found: Solution, begin: Float[Tensor, "s n"], samples: Int[Tensor, " s"]) -> Solution:
    """From where some goals are far off: without those, or after all with them, where that strains no body."""
    body, solver, limits = setting.body_costs(), setting.solver, setting.thresholds

    def taken(into: Solution, new: Solution, reason: Reason | None) -> Solution:
        return into.merged(new, samples, ~body.strained(setting.motion(new)), reason)

    freed = setting.solve(body.robust(), begin, approach(solver, limits))
    found = taken(found, freed, "strained")
    alone = setting.solve(body.without_outliers, freed.value, finish(solver, limits))
    found = taken(found, alone, "strained")
    return taken(found, setting.solve(setting.goals, begin, finish(solver, limits)), None)


def polish(setting: Setting, found: Solution) -> Solution:
    """The last centimetre of samples that have no more to go: in joints, or else through the decoder."""
    motion, objective, context = setting.motion(found), setting.objective, setting.context
    near = (setting.goals.met(motion, context) & ~objective.met(motion, context)).nonzero()[:, 0]
    if not len(near):
        return found
    some = replace(motion, joints=motion.joints[near], valid=motion.valid[near])
    done, moves = torch.zeros_like(near, dtype=torch.bool), torch.zeros_like(some.joints)
    step = MappedStep(SmoothStep.of(some, setting.thresholds), rigid)
    settings = polishing(setting.solver, setting.thresholds)
    joints = Setting(step, objective, context, settings, setting.count, setting.thresholds)
    # Targets alone, as so small a move takes other goals out of their tolerances but seldom; then all goals.
    for goals in (Objective(tuple(t for t in objective.counted if t.spec.pulls)), objective):
        after = joints.motion(joints.solve(goals))
        good = kept(some, after, setting.thresholds) & objective.met(after, context) & ~done
        moves[good] = (after.joints - some.joints)[good]
        done |= good
        if done.all():
            break
    whole = torch.zeros_like(motion.joints)
    whole[near] = moves
    if not done.all():
        found = _finished(setting.of(near[~done]), found, near[~done])
    return replace(found, moves=whole)


def _finished(setting: Setting, found: Solution, samples: Int[Tensor, " s"]) -> Solution:
    """Through the decoder at the goals' own tolerances, for samples that could not be polished."""
    last = setting.solve(setting.objective, found.value[samples], finish(setting.solver, setting.thresholds))
    better = setting.objective.met(setting.motion(last), setting.context)
    if setting.solver.natural:
        better &= ~setting.body_costs().strained(setting.motion(last), setting.thresholds.met_bones)
    return found.merged(last, samples, better)
