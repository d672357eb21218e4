"""Why a motion doesn't meet its goals, in a sentence: which target is to blame, and whether any body could meet it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import torch

from objectives.context import Context
from objectives.objective import Objective
from objectives.term import Term
from scenes.motion.motion import Motion

FASTEST = 8.0
"""Speed (m/s) that no joint keeps up on its way from one target to the next; a sprinter's pelvis makes 10."""
LEAP = 0.5
"""How far (m) a standing person can leave the ground."""
_NAMED = 3
"""Targets that a sentence names before it says 'and so many more'."""
_DENSE = 64
"""Entries of a term beyond which it is spoken of as a whole: a wall, a track."""


@dataclass(frozen=True)
class _Target:
    """One thing that a goal asks: a joint at a place and time, or a whole term's worst.

    Attributes:
        label: as a sentence names it.
        miss: by how much it is missed, in `unit`, of which `metre` counts as one.
        met: within the tolerance.
        joint, time, place: where a joint shall be (world m, s); None for other goals.
        ground: height (m, world) of the ground under that place, where the scene knows it.
    """

    label: str
    miss: float
    unit: str
    metre: float
    met: bool
    joint: str | None = None
    time: float = 0.0
    place: tuple[float, float, float] | None = field(default=None)
    ground: float | None = None


def diagnosis(objective: Objective, motion: Motion, context: Context) -> str | None:
    """What is not met and why, in a sentence, of one motion ``[T, J, 3]``; None where all is met.

    A target is out of reach by what no body could make up for: the ground below it, the length of its limbs from there,
    from the start or from another target at `FASTEST`.
    """
    with torch.no_grad():
        found = {term.name: _targets(term, motion, context) for term in objective.counted}
    targets = [target for some in found.values() for target in some]
    missed = [t for t in targets if not t.met]
    said = [f"{name} is never active" for name, some in found.items() if not some]
    if not missed and not said:
        return None
    innocent = list(targets)
    while missed and len(said) < _NAMED:
        worst = max(missed, key=lambda t: _severity(t, innocent, motion))
        said.append(_sentence(worst, innocent, motion))
        missed.remove(worst)
        innocent.remove(worst)  # what one target shuts out is no further fault of the others
    if missed:
        said.append("1 more is not met" if len(missed) == 1 else f"{len(missed)} more are not met")
    others = [t for t in targets if t.met and t.unit == "m"]
    if others:
        said.append(f"the others to {_metres(max(t.miss for t in others))}")
    return "; ".join(said)


def out_of_reach(objective: Objective, motion: Motion, context: Context) -> int:
    """How many targets no body could meet, beside the others and the start of one motion ``[T, J, 3]``."""
    with torch.no_grad():
        targets = [target for term in objective.counted for target in _targets(term, motion, context)]
    return sum(bool(_conflicts(target, targets, motion)) for target in targets)


def _targets(term: Term, motion: Motion, context: Context) -> list[_Target]:
    found = term.evaluate(motion, context)
    size, active = found.square.sqrt(), found.mask.nonzero().tolist()
    if not active:
        return []
    places = found.targets
    drawn = places is not None and not bool(places.isnan().all(-1)[found.mask].any())
    if places is None or not drawn or len(active) > _DENSE:
        report = term.report(motion, context)[0]
        return [_Target(term.name, report.worst, term.spec.unit, term.spec.metre, report.met, None, report.when or 0.0)]
    targets = []
    for number, (frame, entry) in enumerate(active):
        time, joint = motion.t0 + frame / motion.fps, found.joints[entry]
        which = f"target {number + 1}" if len(active) > 1 else "the target"
        name = f"{term.name}: {which}" if term.name != term.goal else which
        x, y, z = places[frame, entry].tolist()
        place = (x, y, z) if math.isfinite(x + y + z) else None
        miss = float(size[frame, entry])
        who = joint or (found.labels[entry] if found.labels else "")
        label = f"{name} ({who.replace('_', ' ')}, {time:.2f} s)" if who else f"{name} ({time:.2f} s)"
        ground = None if place is None else context.ground_under(torch.tensor([place]))
        below = None if ground is None else float(ground)
        unit, metre = term.spec.unit, term.spec.metre
        targets.append(_Target(label, miss, unit, metre, miss <= term.allowed, joint, time, place, below))
    return targets


def _severity(target: _Target, targets: list[_Target], motion: Motion) -> float:
    """What no body could meet comes first, then what is missed most."""
    return 100.0 * sum(amount for amount, _ in _conflicts(target, targets, motion)) + target.miss / target.metre


def _conflicts(target: _Target, targets: list[_Target], motion: Motion) -> list[tuple[float, str]]:
    """By how many metres a target is out of reach of what, each a lower bound that holds for any motion."""
    if target.joint is None or target.place is None:
        return []
    skeleton, here = motion.skeleton, torch.tensor(target.place)
    ground = float(motion.joints[..., 1].amin())
    reach = skeleton.span("left_foot", target.joint) + LEAP
    under = ground if target.ground is None else max(ground, target.ground)  # it may be over a step
    found = [(target.place[1] - under - reach, ""), (ground - target.place[1], "")]
    begin = motion.joint("pelvis")[0].to(here)
    way = skeleton.span("pelvis", target.joint) + FASTEST * (target.time - motion.t0)
    found.append((float((here - begin).norm()) - way, "of the start"))
    for other in targets:
        if other is not target and other.joint is not None and other.place is not None:
            way = skeleton.span(other.joint, target.joint) + FASTEST * abs(other.time - target.time)
            found.append((float((here - torch.tensor(other.place)).norm()) - way, f"of {other.label}"))
    return [(amount, what) for amount, what in found if amount > 0.005]


def _sentence(target: _Target, targets: list[_Target], motion: Motion) -> str:
    missed = _metres(target.miss) if target.unit == "m" else f"{target.miss:.3g} {target.unit}"
    conflicts = _conflicts(target, targets, motion)
    if not conflicts:
        return f"{target.label} is met to {missed} only"
    amount, what = max(conflicts)
    # Two targets that shut each other out are each other's fault; one that many others shut out is to blame itself.
    what = f" {what}" if what and len(conflicts) == 1 else ""
    return f"{target.label} is {_metres(amount)} out of reach{what}; met to {missed}"


def _metres(value: float) -> str:
    return f"{1000 * value:.0f} mm" if value < 0.0095 else f"{100 * value:.0f} cm"
