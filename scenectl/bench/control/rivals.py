"""The ways of reaching keyframes that `scenectl bench control` compares: others' as published, and ours."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from objectives import Context, Objective, Term
from scenectl.bench.control.keyframes import Keyframes
from scenectl.control import ObjectiveGuide, SolverSettings, refine
from scenectl.control.refine.polish import SmoothStep
from scenectl.generators.base import Generator, Guide, Progress, Step
from scenectl.generators.mscot.posterior import Scale
from scenectl.generators.mscot.sampling import MSCoT
from scenectl.networks.text import TextEncoder, TextFeatures
from scenes.body.body import DEFAULT_BODY
from scenes.errors import UserError
from scenes.motion.motion import Motion
from scenes.world.scene import Scene

METHODS = ("paper", "paper-best-step", "controlmm", "adam", "lbfgs", "scenectl")
OF_TOKENS = ("controlmm",)
"""Those that draw MSCoT's tokens, and run with no other generator."""
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

    @property
    def context(self) -> Context:
        """The body in that scene."""
        return Context(self.scene, DEFAULT_BODY)

    def objective(self, tolerance: float = TOLERANCE) -> Objective:
        """The keyframes, met within a tolerance (m; 0 is never met), and what is asked for besides."""
        return Objective((self.keyframes.goal(tolerance), *self.goals))


class Remembered:
    """A text encoder that encodes nothing twice: the time that it takes counts for no method."""

    def __init__(self, encoder: TextEncoder) -> None:
        self.encoder, self.known = encoder, dict[tuple[str, ...], TextFeatures]()
        self.name, self.dim = encoder.name, encoder.dim

    def encode(self, prompts: list[str]) -> TextFeatures:
        if tuple(prompts) not in self.known:
            self.known[tuple(prompts)] = self.encoder.encode(prompts)
        return self.known[tuple(prompts)]


def remembering(generator: Generator) -> Generator:
    """The same generator with a text encoder that encodes nothing twice; other families are returned as they are."""
    if not isinstance(generator, MSCoT):
        return generator
    bundle = replace(generator.bundle, text=Remembered(generator.bundle.text))
    return MSCoT(bundle, generator.sampling, generator.posterior)


class Counted:
    """A guide that counts what it is asked: each answer is a pass through the decoder."""

    def __init__(self, guide: Guide) -> None:
        self.guide, self.passes = guide, 0

    def log_prob(self, step: Step) -> Float[Tensor, " S"]:
        self.passes += 1
        return self.guide.log_prob(step)

    def gradient(self, step: Step) -> Float[Tensor, "S *v"]:
        self.passes += 1
        return self.guide.gradient(step)


def on_logits(scale: Scale, guide: Guide) -> Float[Tensor, "S L_k V"]:
    """ControlMM's posterior: AdamW on each scale's logits instead of one tilt."""
    return _descended(
        scale.prior, LOGIT_STEPS, lambda logits: scale.step.at(logits.softmax(-1) @ scale.codes), guide
    ).log_softmax(-1)


def on_embeddings(step: Step, guide: Guide) -> Float[Tensor, "S *v"]:
    """ControlMM's refinement: AdamW on a step's value, so many iterations."""
    return _descended(step.value, EMBEDDING_STEPS, step.at, guide)


def _descended(value: Tensor, steps: int, step_at: Callable[[Tensor], Step], guide: Guide) -> Tensor:
    """Where AdamW leads from a value, down the guide's negative log-likelihood of the step that it stands for."""
    value = value.detach().clone().requires_grad_(True)
    optimiser = torch.optim.AdamW([value], lr=RATE)
    with torch.enable_grad():
        for _ in range(steps):
            optimiser.zero_grad()
            (-guide.log_prob(step_at(value)).sum()).backward()
            optimiser.step()
    return value.detach()


@dataclass(frozen=True)
class Reached:
    """What a way came to.

    Attributes:
        motion, unrefined: after refinement and before it.
        seconds: of refinement.
        passes: through the decoder, those of guidance included.
    """

    motion: Motion
    unrefined: Motion
    seconds: float
    passes: int


Way = Callable[[Case], Reached]
Refinement = Callable[[Step, Case], tuple[Motion, int]]
"""Refines a draft's last step for a case; returns the motion and its passes."""


def _way(generator: Generator, refinement: Refinement, case: Case) -> Reached:
    """Draft under guidance, then refine."""
    guide = Counted(ObjectiveGuide(case.objective(), case.context))
    draft = case.keyframes.drafted(generator, guide)
    step = SmoothStep.of(draft.motion) if draft.step is None else draft.step
    began = time.perf_counter()
    motion, passes = refinement(step, case)
    return Reached(motion, draft.motion, time.perf_counter() - began, guide.passes + passes)


def _solved(solver: SolverSettings, tolerance: float, step: Step, case: Case) -> tuple[Motion, int]:
    found = refine(step, case.objective(tolerance), case.context, solver)
    return found.motion, found.solution.evaluations if found.solution else 0


def _controlmm(step: Step, case: Case) -> tuple[Motion, int]:
    guide = Counted(ObjectiveGuide(case.objective(), case.context))
    return step.at(on_embeddings(step, guide)).motion, guide.passes


def ways(generator: Generator, cases: Sequence[Case], methods: Sequence[str], progress: Progress) -> dict[str, Way]:
    """The ways of some `METHODS`, all with one generator.

    Args:
        generator: whose steps and decoder all of them use; its texts are encoded once where it is `remembering`.
        cases: on the first of which `paper-best-step` finds its step.
        methods: names.
        progress: called with what is being done before that.

    Raises:
        UserError: a method of `OF_TOKENS`, and a generator that is no MSCoT.
    """
    other, rival = _without_metric(generator, methods)

    def by_solver(tolerance: float = TOLERANCE, **settings: object) -> Way:
        alone = {"natural": False, "polish": False, "iterations": PAPER_STEPS, "patience": PAPER_STEPS + 1}
        solver = SolverSettings.model_validate(alone | settings)  # patient, as Adam's cost rises at first
        return partial(_way, other, partial(_solved, solver, tolerance))

    def ascent(step: float) -> Way:
        return by_solver(0.0, name="gradient", step=step, prior=0.0)

    known: dict[str, Way] = {
        "paper": ascent(PAPER_STEP),
        "controlmm": partial(_way, rival, _controlmm),
        "adam": by_solver(name="adam"),
        "lbfgs": by_solver(name="lbfgs"),
        "scenectl": partial(_way, generator, partial(_solved, SolverSettings(), TOLERANCE)),
    }
    if "paper-best-step" in methods:
        progress("the paper's best step", 0.0)
        known["paper-best-step"] = ascent(_best_step(ascent, cases))
    return {name: known[name] for name in methods}


def _without_metric(generator: Generator, methods: Sequence[str]) -> tuple[Generator, Generator]:
    """What others search with, embeddings as they are: under our guidance, and under ControlMM's."""
    if isinstance(generator, MSCoT):
        plain = replace(generator.bundle, metric=None)
        return MSCoT(plain, generator.sampling), MSCoT(plain, generator.sampling, on_logits)
    for method in methods:
        if method in OF_TOKENS:
            raise UserError(f"method '{method}' draws MSCoT's tokens, and generator '{generator.name}' has none")
    return generator, generator


def possible(generator: Generator) -> tuple[str, ...]:
    """The methods that run with a generator."""
    return METHODS if isinstance(generator, MSCoT) else tuple(m for m in METHODS if m not in OF_TOKENS)


def _best_step(ascent: Callable[[float], Way], cases: Sequence[Case]) -> float:
    def error(step: float) -> float:
        few = cases[:: max(1, len(cases) // 4)][:4]
        return statistics.fmean(float(case.keyframes.errors(ascent(step)(case).motion).mean()) for case in few)

    return min(STEPS_TRIED, key=error)
