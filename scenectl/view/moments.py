"""Which moments of a motion a picture shows: those that goals and the verdict are about, its ends, and some between."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import torch

from objectives import Context, Mark, Term, TermReport
from scenectl.measures.believability.verdict import Finding, Verdict
from scenes.motion.motion import Motion

APART = 0.5
"""Metres that a pelvis goes from one moment to the next before the two bodies stand apart: about a person's width."""
_WAY, _PAUSE, _BETWEEN = 0.6, 0.8, 8
"""Metres or, where that is sooner, seconds from one moment to the next; how many there are without goals at most."""
_SAME = 0.15
"""Seconds within which two moments are one: a step takes four times as long."""
_SHORT, _WHOLE = 0.3, 0.9
"""Seconds up to which a span of a goal is one moment, and the share of a motion from which a goal is about no span."""
_CLOSE = 0.5
"""Share of its tolerance from which the worst moment of a goal that is met is worth a look."""
_MOST = 12
"""Moments at most that goals and findings ask for."""
_FINDING, _MISSED, _ACT, _MET, _END, _WORST, _FILL = range(7)
"""What is shown first where not all can be."""


@dataclass(frozen=True)
class Seen:
    """What pictures show of a goal.

    Attributes:
        name: of its term.
        marks: what there is to see of it.
        active: frames at which it applies, ``[T]``.
        at: what there is to see of it at a frame.
        report: how well it is met; None where that is not known.
    """

    name: str
    marks: Sequence[Mark]
    active: np.ndarray
    at: Callable[[int], Sequence[Mark]] = lambda frame: ()
    report: TermReport | None = None

    def applies(self, frame: int) -> bool:
        """It applies at a frame."""
        return bool(self.active[frame])

    @property
    def met(self) -> bool:
        """It is known to be met."""
        return self.report is not None and self.report.met


def seen(term: Term, motion: Motion, context: Context, report: TermReport | None = None) -> Seen:
    """A term as pictures show it beside one motion ``[T, J, 3]``. No distance of the scene is asked."""
    with torch.no_grad():
        found = term.evaluate(motion, context.unbaked)
    active = found.mask.any(-1).cpu().numpy()

    def at(frame: int) -> Sequence[Mark]:
        return term.marks_of(found, slice(frame, frame + 1)) if active[frame] else ()

    return Seen(term.name, term.marks_of(found), active, at, report)


@dataclass(frozen=True)
class Shown:
    """An action of a script as pictures show it: its name, and from when to when (s) it is done."""

    name: str
    begin: float
    end: float


@dataclass(frozen=True)
class Moment:
    """A moment to show: its frame, its rank (0 comes first) and what it is about, by name."""

    frame: int
    rank: int = _FILL
    about: tuple[str, ...] = ()

    @property
    def asked(self) -> bool:
        """Something is about it: it is not just one between others."""
        return self.rank < _FILL


def moments_of(
    motion: Motion, goals: Sequence[Seen], verdict: Verdict | None, acts: Sequence[Shown] = ()
) -> list[Moment]:
    """Moments of one motion ``[T, J, 3]``, the earliest first: what goals and findings are about, and some between.

    Of a script there is one for each act, and of its goals those that are missed.
    """
    last = int(motion.valid.sum()) - 1
    if last < 1:
        return [Moment(0, _END)]
    asked = [*_of_verdict(motion, verdict), *(m for goal in goals for m in _of_goal(motion, goal, last))]
    if acts:
        asked = [m for m in asked if m.rank < _ACT] + [_of_act(motion, act, goals, last) for act in acts]
    chosen: list[Moment] = []
    for moment in sorted([*asked, Moment(0, _END), Moment(last, _END)], key=lambda moment: moment.rank):
        near = next((k for k, c in enumerate(chosen) if abs(c.frame - moment.frame) <= _SAME * motion.fps), None)
        if near is None and (len(chosen) < _MOST or moment.rank == _END):
            chosen.append(moment)
        elif near is not None:
            about = tuple(dict.fromkeys((*chosen[near].about, *moment.about)))
            chosen[near] = replace(chosen[near], about=about)
    return sorted([*chosen, *_between(motion, chosen, last)], key=lambda moment: moment.frame)


def called(check: str) -> str:
    """A check's name in words, without the time that it looks at: "sliding" of "sliding_2s"."""
    return re.sub(r"_[\d.]+s$", "", check).replace("_", " ")


def _of_verdict(motion: Motion, verdict: Verdict | None) -> Iterator[Moment]:
    findings: Sequence[Finding] = () if verdict is None else verdict.findings
    for k, finding in enumerate(findings):
        if finding.at_s is not None:
            yield Moment(_frame(motion, finding.at_s), _FINDING if k == 0 else _WORST, (called(finding.check),))


def _of_goal(motion: Motion, goal: Seen, last: int) -> Iterator[Moment]:
    """The beginning, middle and end of each span of a goal; of one about the whole motion, its worst moment."""
    report, frames = goal.report, np.flatnonzero(goal.active[: last + 1])
    missed = report is not None and not report.met
    if len(frames) <= _WHOLE * (last + 1):
        for run in np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1) if len(frames) else ():
            first, end = int(run[0]), int(run[-1])
            short = end - first <= _SHORT * motion.fps
            for frame in ((first + end) // 2,) if short else (first, (first + end) // 2, end):
                yield Moment(frame, _MISSED if missed else _MET, (goal.name,))
    if report is not None and report.when is not None and (missed or report.worst > _CLOSE * report.tolerance):
        yield Moment(_frame(motion, report.when), _MISSED if missed else _WORST, (goal.name,))


def _of_act(motion: Motion, act: Shown, goals: Sequence[Seen], last: int) -> Moment:
    """The moment of an act at which most goals apply: the middle one of them."""
    before, end = (min(_frame(motion, time), last) for time in (act.begin, act.end))
    first = min(before + 1, end)  # the frame between two acts is the earlier one's
    count = sum(
        (goal.active[first : end + 1].astype(int) for goal in goals), start=np.zeros(end + 1 - first, dtype=int)
    )
    most = np.flatnonzero(count == count.max())
    return Moment(first + int(most[len(most) // 2]), _ACT, (act.name,))


def _between(motion: Motion, chosen: Sequence[Moment], last: int) -> Iterator[Moment]:
    """Moments in the gaps that others leave, evenly by way and time."""
    way = motion.joint("pelvis")[: last + 1, [0, 2]].diff(dim=0).norm(dim=-1).double().cpu().numpy()
    passed = np.concatenate([[0.0], np.cumsum(np.maximum(way / _WAY, 1 / (_PAUSE * motion.fps)))])
    step = max(1.0, passed[-1] / (_BETWEEN - 1))
    for before, after in pairwise(sorted(moment.frame for moment in chosen)):
        count = round((passed[after] - passed[before]) / step)
        for value in np.linspace(passed[before], passed[after], count + 1)[1:-1] if count > 1 else ():
            yield Moment(int(np.abs(passed - value).argmin()))


def _frame(motion: Motion, seconds: float) -> int:
    last = int(motion.valid.sum()) - 1
    return int(np.clip(round((seconds - motion.t0) * motion.fps), 0, last))
