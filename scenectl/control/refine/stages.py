"""The stages of a refinement: a search for all goals, relief of bodies that goals lift, and polishing of joints.

Each is a function of its setting and of what the stage before it found; none changes what it is given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from jaxtyping import Bool, Int
from torch import Tensor

from objectives import Context, Objective
from scenectl.control.refine.body_costs import approach, finish, leads, pose_costs, walk_costs
from scenectl.control.refine.polish import SmoothStep, kept, polishing
from scenectl.control.refine.setting import Setting
from scenectl.control.rise import Rise
from scenectl.control.solvers.problem import Solution
from scenes.motion.motion import Motion

Stage = Callable[[Setting, Solution], Solution]


def solved(setting: Setting) -> Solution:
    """The values that meet goals best (Eq. 12), through every stage that the settings ask for."""
    found = search(setting)
    stages: list[Stage] = [relieve] if setting.solver.natural else []
    stages += [bring, polish] if setting.solver.polish else []
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
    least = max(solver.least, setting.thresholds.led_steps) if costs else solver.least
    solver = solver.model_copy(update={"least": least})
    few = {"iterations": min(solver.lead, solver.iterations)}
    led = setting.solve(Objective((*leading, *(costs if level else ()))), settings=solver.model_copy(update=few))
    found = setting.solve(goals, led.value, solver)
    found = replace(found, evaluations=found.evaluations + led.evaluations)
    lost = ~(setting.cost(setting.motion(found)) <= setting.cost(step.motion))  # nan, too
    samples = lost.nonzero()[:, 0]
    if not len(samples):
        return found
    return found.merged(setting.of(samples).solve(goals), samples, torch.ones_like(lost[lost]))


def relieve(setting: Setting, found: Solution) -> Solution:
    """Solved anew, with a body's costs, for samples that goals lift off the ground or push into it (`body_costs`)."""
    goals, context, limits = setting.goals, setting.context, setting.thresholds
    if leads(goals, setting.step.motion, context, limits.led):
        return found
    after, body = setting.motion(found), setting.body_costs()
    gone = torch.tensor([reason == "abandoned" for reason in found.reasons], device=found.value.device)
    samples = (body.off_ground(after, context) & ~gone).nonzero()[:, 0]
    if not len(samples):
        return found
    near = (goals.met(after, context) & ~body.off_ground(after, context, limits.near_feet))[samples]
    setting = setting.of(samples)
    body, own = setting.body_costs(), setting.step.value.flatten(1)
    held = setting.solve(body, torch.where(near[:, None], found.value[samples], own), approach(setting.solver, limits))
    found = found.merged(held, samples, torch.ones_like(near), "lifted")
    alone = setting.solve(body.without_outliers, held.value, finish(setting.solver, limits))
    return found.merged(alone, samples, ~body.off_ground(setting.motion(alone), context), "lifted")


def bring(setting: Setting, found: Solution) -> Solution:
    """Samples that are off a body that goals ask for joint by joint, in joints: at first smoothly, then finely.

    Such goals leave nothing to the decoder but what lies between, and it comes no nearer than it reconstructs. What
    then is missed yet is left to the goals alone. A move is kept where it is nearer, and meets what was met before.
    """
    motion, objective, context, limits = setting.motion(found), setting.objective, setting.context, setting.thresholds
    missed = (~objective.met(motion, context)).nonzero()[:, 0]
    if not len(missed) or not _asks_for_bodies(objective, motion, context, limits.body_joints):
        return found
    before = after = motion[missed]
    settings = setting.solver.model_copy(update={"name": "auto", "step": None, "enough": None, "lead": 0})
    costly = Objective((*objective.terms, *pose_costs(limits)))
    smooth, fine = (2 * limits.spread_time, limits.spread_bones), (limits.fine_time, limits.fine_bones)
    for goals, (time, limbs) in ((costly, smooth), (costly, fine), (objective, fine)):
        joints = setting.in_joints(replace(SmoothStep.of(after, limits), time=time, limbs=limbs), settings)
        after = joints.motion(joints.solve(goals))
        if objective.met(after, context).all():
            break
    moves, good = torch.zeros_like(motion.joints), _nearer(objective, before, after, context)
    moves[missed[good]] = (after.joints - before.joints)[good]
    return replace(found, moves=moves)


def _asks_for_bodies(objective: Objective, motion: Motion, context: Context, least: int) -> bool:
    """Whether a goal that pulls asks for so many joints at once."""
    with torch.no_grad():
        found = [term.evaluate(motion, context) for term in objective.counted if term.spec.pulls]
    return any(int(one.mask.sum(-1).max()) >= least for one in found)


@torch.no_grad()
def _nearer(objective: Objective, before: Motion, after: Motion, context: Context) -> Bool[Tensor, " S"]:
    """Samples that meet all goals after a move, or whose cost fell while no goal that was met is missed."""
    now, then = (torch.stack([t.met(m, context) for t in objective.counted]) for m in (after, before))
    fell = objective.cost(after, context) < objective.cost(before, context)
    return now.all(0) | (fell & (now | ~then).all(0))


def polish(setting: Setting, found: Solution) -> Solution:
    """The last centimetre of samples that have no more to go: in joints, or else through the decoder."""
    motion, objective, context = setting.motion(found), setting.objective, setting.context
    near = (setting.goals.met(motion, context) & ~objective.met(motion, context)).nonzero()[:, 0]
    if not len(near):
        return found
    some = motion[near]
    done, moves = torch.zeros_like(near, dtype=torch.bool), torch.zeros_like(some.joints)
    joints = setting.in_joints(SmoothStep.of(some, setting.thresholds), polishing(setting.solver, setting.thresholds))
    # Targets alone, as so small a move takes other goals out of their tolerances but seldom; then all goals.
    for goals in (Objective(tuple(t for t in objective.counted if t.spec.pulls)), objective):
        after = joints.motion(joints.solve(goals))
        good = kept(some, after, setting.thresholds) & objective.met(after, context) & ~done
        moves[good] = (after.joints - some.joints)[good]
        done |= good
        if done.all():
            break
    whole = torch.zeros_like(motion.joints) if found.moves is None else found.moves.clone()
    whole[near] += moves
    if not done.all():
        found = _finished(setting.of(near[~done]), found, near[~done])
    return replace(found, moves=whole)


def _finished(setting: Setting, found: Solution, samples: Int[Tensor, " s"]) -> Solution:
    """Through the decoder at the goals' own tolerances, for samples that could not be polished."""
    last = setting.solve(setting.objective, found.value[samples], finish(setting.solver, setting.thresholds))
    better = setting.objective.met(setting.motion(last), setting.context)
    if setting.solver.natural:
        better &= ~setting.body_costs().off_ground(setting.motion(last), setting.context)
    return found.merged(last, samples, better)
