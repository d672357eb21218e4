"""Search over a task: its parts are made one after the other, and the best beginnings go on.

As a whole, a script of six acts would need six lucky samples at once. Here every act is made from what came before it,
and of all beginnings the few that meet their goals and can be believed are gone on from, each several times: a beam
search over beginnings, within the number of samples that was asked for.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import torch

from scenectl.control import GuidanceSettings, SolverSettings
from scenectl.control.solvers.problem import Reason, Solution
from scenectl.generators.base import EditingGenerator, Progress
from scenectl.generators.prompts import Prompts
from scenectl.generators.spec import Spec
from scenectl.measures.believability.judge import Judge
from scenectl.measures.metrics import Scorer
from scenectl.pipeline.generation import Made, make
from scenectl.pipeline.going_on import Lead, about, go_on, unpadded
from scenectl.pipeline.parts import CONTEXT
from scenectl.tasks.setup import Setup
from scenes.motion.bones import rest_pose
from scenes.motion.motion import Motion

SHARE = 0.5
"""Share of the samples that go on after a part, at most: those with the fewest parts missed. Each of them goes on as
often as to make up for the others. Ours."""

ENOUGH = 0.75
"""Share of the samples that meet a part's goals at which the search for the others ends, more than go on. Ours."""


@dataclass(frozen=True)
class Begun:
    """A beginning of a script.

    Attributes:
        motion, unrefined: so far, ``[T, J, 3]``.
        missed: parts that did not meet their goals, or could not be believed.
        cost: of the goals of all parts.
        reason: why the search for the last one ended.
    """

    motion: Motion
    unrefined: Motion
    missed: int = 0
    cost: float = 0.0
    reason: Reason | None = None


def parts_of(setup: Setup, spec: Spec, least: int) -> list[tuple[int, int]]:
    """First frame and end of the parts in which a task is made: acts of a script, and of longer ones their sentences.

    The first has `least` frames at least, and each leaves room for what it goes on from. Of an act of several
    sentences the last ones stay together, as far as they go: who sits down turns for it.
    """
    most, cuts, fps = spec.window_frames - CONTEXT, [0], spec.fps
    for one in () if setup.script is None else setup.script.stretches:
        end, said = round(one.end * fps), [round(p.begin * fps) for p in one.act.prompts(one.begin, one.end)]
        cuts += [*_cut(cuts[-1], end, said, most), end]
    if setup.script is None:
        end, said = round(setup.seconds * fps), [round(p.begin * fps) for p in setup.prompts.sentences]
        cuts += [*_cut(0, end, said, most), end]
    while len(cuts) > 2 and cuts[1] < least:
        del cuts[1]
    return list(pairwise(cuts))


def _cut(begin: int, end: int, said: list[int], most: int) -> list[int]:
    """Frames at which a stretch is cut into parts of `most` frames: where a sentence begins, or else evenly."""
    if end - begin <= most:
        return []
    at = next((s for s in said if begin < s and end - most <= s < end), None)
    if at is not None:
        return [*_cut(begin, at, said, most), at]
    count = math.ceil((end - begin) / most)
    return [begin + round((end - begin) * k / count) for k in range(1, count)]


@dataclass(frozen=True)
class Search:
    """How motions of a task are searched for.

    Attributes:
        generator: one that can edit.
        setup: of the task.
        solver, guidance, free_start, samples, seed, progress: as `make` takes them.
        lead: what the motions go on from, ``[T, J, 3]`` up to 0 s; None where they begin with the task.
    """

    generator: EditingGenerator
    setup: Setup
    solver: SolverSettings
    guidance: GuidanceSettings
    free_start: bool
    samples: int
    seed: int
    progress: Progress
    lead: Motion | None = None

    def run(self) -> Made:
        """Motions of the whole task, ``[samples, T, J, 3]``."""
        spec = self.generator.spec
        known = 0 if self.lead is None else self.lead.frames
        parts = parts_of(self.setup, spec, max(1, spec.shortest_frames - known))
        begun = [] if self.lead is None else [Begun(self.lead, self.lead)]
        passes, solver, trace = 0, "", dict[str, object]()
        for k, (first, end) in enumerate(parts):
            tell = self._telling(k, len(parts))
            before = self._best(begun) if begun else []
            how = self._solver(last=k == len(parts) - 1)
            made = self._onward(before, k, end - first, how, tell) if before else self._first(end, how, tell)
            begun = list(self._judged(before, made))
            if made.solution is not None:
                passes, solver = passes + made.solution.evaluations, made.solution.solver
            trace = made.trace
        motion, unrefined = (
            unpadded(one[0], torch.stack([m.joints[known:] for m in one]), t0=0.0)
            for one in ([b.motion for b in begun], [b.unrefined for b in begun])
        )
        nothing = motion.joints.new_zeros(len(begun), 0)
        reasons: list[Reason] = [one.reason for one in begun if one.reason is not None]
        return Made(motion, unrefined, Solution(solver, nothing, nothing.sum(1), reasons, passes), trace)

    def _best(self, begun: Sequence[Begun]) -> list[Begun]:
        """A beginning for each sample to go on from: those with the fewest parts missed, in turn."""
        least = min(one.missed for one in begun)
        good = sorted((one for one in begun if one.missed == least), key=lambda one: one.cost)
        few = good[: math.ceil(SHARE * self.samples)]
        return [few[k % len(few)] for k in range(self.samples)]

    def _solver(self, last: bool) -> SolverSettings:
        """How a part is searched: but for the last, not all samples need meet its goals, as some are given up."""
        if last or self.solver.enough is not None:
            return self.solver
        return self.solver.model_copy(update={"enough": math.ceil(ENOUGH * self.samples)})

    def _first(self, frames: int, solver: SolverSettings, tell: Progress) -> Made:
        """The first part, from the start on."""
        setup, seconds = self.setup, frames / self.generator.spec.fps
        goals = about(setup.objective, setup.context, self._standing(frames))
        return make(
            self.generator, self._prompts.within(0.0, seconds), seconds, setup.start, goals, setup.context,
            solver=solver, guidance=self.guidance, free_start=self.free_start, samples=self.samples,
            seed=self.seed, progress=tell,
        )  # fmt: skip

    def _onward(self, before: Sequence[Begun], k: int, frames: int, solver: SolverSettings, tell: Progress) -> Made:
        """Part k after a beginning for each sample."""
        lead = Lead.of(unpadded(before[0].motion, torch.stack([one.motion.joints for one in before])), frames)
        seed = int(np.random.SeedSequence([self.seed, k]).generate_state(1)[0])
        return go_on(
            self.generator, lead, self._prompts, self.setup.objective, self.setup.context, solver=solver,
            guidance=self.guidance, seed=seed, progress=tell,
        )  # fmt: skip

    def _judged(self, before: Sequence[Begun], made: Made) -> Iterator[Begun]:
        """Beginnings with what was made after each, and what that is worth."""
        drafts = made.motion if made.unrefined is None else made.unrefined
        for i in range(len(made.motion.joints)):
            new, draft, reason = made.motion[i], drafts[i], None if made.solution is None else made.solution.reasons[i]
            if not before:
                yield Begun(new, draft, *self._worth(new, 0), reason)
                continue
            one = before[i]
            lead = unpadded(
                one.motion, one.motion.joints[-CONTEXT:], new.t0 - min(CONTEXT, one.motion.frames) / new.fps
            )
            missed, cost = self._worth(_after(lead, new), lead.frames)
            whole, sketch = _after(one.motion, new), _after(one.unrefined, draft)
            yield Begun(whole, sketch, one.missed + missed, one.cost + cost, reason)

    def _worth(self, seen: Motion, first: int) -> tuple[int, float]:
        """Whether goals about a motion ``[T, J, 3]`` from the `first` frame on are missed, or it is not believable;
        and what they cost."""
        objective, context = self.setup.objective, self.setup.context
        with torch.no_grad():
            cost, met = about(objective, context, seen, first).judge(seen, context)
        return int(not (met and self._judge.verdict(seen).believable)), float(cost)

    @cached_property
    def _judge(self) -> Judge:
        scorer = Scorer(self.setup.scene, self.setup.body, baked=True)
        return Judge.of(scorer, self.setup.prompts, self.setup.objective)

    @cached_property
    def _prompts(self) -> Prompts:
        """The sentences, act by act as a generator follows them, before the motion is cut into parts."""
        return self.setup.prompts.act_by_act(self.setup.seconds)

    def _standing(self, frames: int) -> Motion:
        """Somebody who stands at the start for so many frames."""
        skeleton = self.setup.body.skeleton
        rest = self.setup.start.apply(rest_pose(skeleton))
        return Motion(rest.expand(frames, -1, -1), fps=self.generator.spec.fps, skeleton=skeleton)

    def _telling(self, k: int, parts: int) -> Progress:
        return lambda what, fraction: self.progress(f"part {k + 1} of {parts}: {what}", fraction)


def _after(before: Motion, motion: Motion) -> Motion:
    """One motion ``[T, J, 3]`` after another."""
    return unpadded(before, torch.cat([before.joints, motion.joints]))
