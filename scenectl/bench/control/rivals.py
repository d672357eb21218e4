"""The ways of reaching keyframes that `scenectl bench control` compares: others' as published, and ours."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from objectives import Context, Term
from scenectl.bench.control.keyframes import Keyframes
from scenectl.control import ObjectiveGuide, SolverSettings
from scenectl.generators.base import Generation, Guide, Progress, Step
from scenectl.generators.mscot.sampling import MSCoT, _State
from scenectl.networks.text import TextEncoder, TextFeatures
from scenes.body.body import DEFAULT_BODY
from scenes.world.scene import Scene

METHODS = ("paper", "paper-best-step", "controlmm", "adam", "lbfgs", "scenectl")
TOLERANCE = 0.001
"""Metres from every keyframe within which methods that know when to stop do so."""

PAPER_STEPS, PAPER_STEP = 200, 0.01
STEPS_TRIED = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2)
"""Among which `paper-best-step` takes what leaves the least error on the first motions."""
LOGIT_STEPS, EMBEDDING_STEPS, RATE = 100, 600, 0.06
"""ControlMM's: AdamW iterations on the logits of every step, on the embeddings at the end, and their rate."""


@dataclass(frozen=True)
class Case:
    """Keyframes in a scene.

    Attributes:
        keyframes: of a recorded motion.
        density: how many, by the name of it.
        scene: through which the recording goes and touches nothing.
        goals: what is asked for besides the keyframes.
    """

    keyframes: Keyframes
    density: str
    scene: Scene
    goals: tuple[Term, ...] = ()

    def guide(self, solver: SolverSettings, tolerance: float = TOLERANCE) -> ObjectiveGuide:
        """Towards the keyframes, met within a tolerance (m); 0 is never met."""
        return self.keyframes.guide(solver, tolerance, Context(self.scene, DEFAULT_BODY), self.goals)


class Remembered:
    """A text encoder that encodes nothing twice: its time is none of the methods' business."""

    def __init__(self, encoder: TextEncoder) -> None:
        self.encoder, self.known = encoder, dict[tuple[str, ...], TextFeatures]()

    @property
    def name(self) -> str:
        return self.encoder.name

    @property
    def dim(self) -> int:
        return self.encoder.dim

    def encode(self, prompts: list[str]) -> TextFeatures:
        if tuple(prompts) not in self.known:
            self.known[tuple(prompts)] = self.encoder.encode(prompts)
        return self.known[tuple(prompts)]


class _Timed:
    """A guide whose refinement is timed."""

    def __init__(self, guide: Guide) -> None:
        self.guide, self.seconds = guide, 0.0

    def log_prob(self, step: Step) -> Tensor:
        return self.guide.log_prob(step)

    def gradient(self, step: Step) -> Tensor:
        return self.guide.gradient(step)

    def refine(self, step: Step) -> Tensor:
        began = time.perf_counter()
        refined = self.guide.refine(step)
        self.seconds = time.perf_counter() - began
        return refined

    def finish(self, made: Generation) -> Generation:
        began = time.perf_counter()
        finished = self.guide.finish(made)
        self.seconds += time.perf_counter() - began
        return finished


class ControlMM(MSCoT):
    """MSCoT's tokens under ControlMM's control: AdamW on each scale's logits instead of one tilt."""

    def _tilted(self, state: _State, prior: Float[Tensor, "S L_k V"], k: int, guide: Guide) -> Tensor:
        codes = self.quantiser.codes(k)
        logits = prior.detach().clone().requires_grad_(True)
        step = self._scale_step(state, prior.exp() @ codes, k)
        optimiser = torch.optim.AdamW([logits], lr=RATE)
        with torch.enable_grad():
            for _ in range(LOGIT_STEPS):
                optimiser.zero_grad()
                (-guide.log_prob(step.at(logits.softmax(-1) @ codes)).sum()).backward()
                optimiser.step()
        return logits.detach().log_softmax(-1)


class _OnEmbeddings(_Timed):
    """A guide whose refinement is ControlMM's: AdamW, so many iterations."""

    def refine(self, step: Step) -> Tensor:
        value = step.value.detach().clone().requires_grad_(True)
        optimiser = torch.optim.AdamW([value], lr=RATE)
        began = time.perf_counter()
        with torch.enable_grad():
            for _ in range(EMBEDDING_STEPS):
                optimiser.zero_grad()
                (-self.guide.log_prob(step.at(value)).sum()).backward()
                optimiser.step()
        self.seconds = time.perf_counter() - began
        return value.detach()


Way = Callable[[Case], tuple[Generation, float, int]]
"""Makes a case's motion; returns it with the seconds and the decoder passes of its refinement."""


def ways(generator: MSCoT, cases: Sequence[Case], methods: Sequence[str], tell: Progress) -> dict[str, Way]:
    """The ways of some `METHODS`, all with the tokens and the decoder of one generator.

    Args:
        generator: theirs; texts had better be remembered (`Remembered`).
        cases: on the first of which `paper-best-step` finds its step.
        methods: names.
        tell: called with what is being done before that.
    """
    scales = generator.quantiser.scales
    plain = replace(generator.bundle, metric=None)  # others search in embeddings as they are
    rival, other = ControlMM(plain, generator.sampling), MSCoT(plain, generator.sampling)

    def solved(solver: SolverSettings, tolerance: float = TOLERANCE, by: MSCoT = other) -> Way:
        def way(case: Case) -> tuple[Generation, float, int]:
            guide = case.guide(solver, tolerance)
            timed = _Timed(guide)
            made = case.keyframes.generate(by, timed)
            return made, timed.seconds, scales + (guide.solution.evaluations if guide.solution else 0)

        return way

    def ascent(step: float) -> Way:
        endless = SolverSettings(
            name="gradient",
            iterations=PAPER_STEPS,
            step=step,
            prior=0.0,
            patience=PAPER_STEPS + 1,
            natural=False,
            polish=False,
        )
        return solved(endless, 0.0)

    def patient(name: str) -> Way:
        steps = {"iterations": PAPER_STEPS, "patience": PAPER_STEPS + 1}  # Adam's cost rises at first
        return solved(SolverSettings.model_validate({"name": name, "natural": False, "polish": False, **steps}))

    def controlmm(case: Case) -> tuple[Generation, float, int]:
        timed = _OnEmbeddings(case.guide(SolverSettings(), 0.0))
        made = case.keyframes.generate(rival, timed)
        return made, timed.seconds, scales * LOGIT_STEPS + EMBEDDING_STEPS

    known: dict[str, Way] = {
        "paper": ascent(PAPER_STEP),
        "controlmm": controlmm,
        "adam": patient("adam"),
        "lbfgs": patient("lbfgs"),
        "scenectl": solved(SolverSettings(), by=generator),
    }
    if "paper-best-step" in methods:
        tell("the paper's best step", 0.0)
        known["paper-best-step"] = ascent(_best_step(ascent, cases))
    return {name: known[name] for name in methods}


def _best_step(ascent: Callable[[float], Way], cases: Sequence[Case]) -> float:
    def error(step: float) -> float:
        few = cases[:: max(1, len(cases) // 4)][:4]
        return statistics.fmean(float(case.keyframes.errors(ascent(step)(case)[0].motion).mean()) for case in few)

    return min(STEPS_TRIED, key=error)
