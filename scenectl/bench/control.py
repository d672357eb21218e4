"""Ways of reaching keyframes, side by side: the paper's, ControlMM's, Adam, L-BFGS and ours, on the same motions."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from objectives import Context, Objective, Term
from scenectl.bench.keyframes import FAILED, JOINTS, usable_clips
from scenectl.control import ObjectiveGuide, SolverSettings
from scenectl.control.natural import bone_errors
from scenectl.data.corpus import Clip
from scenectl.data.features import FPS, canonicalise
from scenectl.generators.base import Generation, Guide, Progress, Step
from scenectl.generators.mscot import MSCoT, _State
from scenectl.metrics import max_acceleration, skating_ratio
from scenectl.models.schedule import MAX_FRAMES
from scenectl.text import TextEncoder, TextFeatures
from scenes.body import DEFAULT_BODY
from scenes.errors import UserError, did_you_mean
from scenes.files import atomic_write
from scenes.motion import Motion, Pose2D
from scenes.scene import Scene
from scenes.skeleton import HUMANML3D

DENSITIES: dict[str, int | float] = {"1": 1, "2": 2, "5": 5, "25%": 0.25, "100%": 1.0}
"""Keyframes, as a number, or as a share of the frames where it is a float."""
METHODS = ("paper", "paper-best-step", "controlmm", "adam", "lbfgs", "scenectl")
TOLERANCE = 0.001
"""Metres from every keyframe within which methods that know when to stop do so."""

PAPER_STEPS, PAPER_STEP = 200, 0.01
STEPS_TRIED = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2)
"""Among which `paper-best-step` takes what leaves the least error on the first motions."""
LOGIT_STEPS, EMBEDDING_STEPS, RATE = 100, 600, 0.06
"""ControlMM's: AdamW iterations on the logits of every step, on the embeddings at the end, and their rate."""

Row = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """One joint of one real motion, to be met at some frames."""

    clip: Clip
    joint: str
    density: str
    at: Tensor
    seed: int

    @cached_property
    def real(self) -> Motion:
        """The clip's first frames, 196 at most."""
        return Motion(canonicalise(self.clip.joints[:MAX_FRAMES]))

    @property
    def wanted(self) -> Float[Tensor, "K 3"]:
        return self.real.joint(self.joint)[self.at]

    def guide(self, solver: SolverSettings, tolerance: float = TOLERANCE) -> ObjectiveGuide:
        """Towards the keyframes, met within a tolerance (m); 0 is never met."""
        target = {"joint": self.joint, "position": self.wanted.tolist()}
        times = [frame / FPS for frame in self.at.tolist()]
        objective = Objective((Term("joint_target", target, tolerance=tolerance, at=times),))
        return ObjectiveGuide(objective, Context(Scene.empty(), DEFAULT_BODY), solver)

    def generate(self, generator: MSCoT, guide: Guide | None) -> Generation:
        return generator.generate(self.clip.captions[0], self.real.frames / FPS, Pose2D(), guide, 1, self.seed)


class _Remembered:
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
        step = self._step(state, prior.exp() @ codes, lambda e: [*state.refined, e])
        optimiser = torch.optim.AdamW([logits], lr=RATE)
        with torch.enable_grad():
            for _ in range(LOGIT_STEPS):
                optimiser.zero_grad()
                (-guide.log_prob(step.at(logits.softmax(-1) @ codes)).sum()).backward()
                optimiser.step()
        return logits.detach().log_softmax(-1)

    def _refine(self, state: _State, guide: Guide) -> list[Tensor]:
        lengths = [e.shape[1] for e in state.refined]
        value = torch.cat(state.refined, dim=1)
        step = self._step(state, value, lambda v: list(v.split(lengths, dim=1)))
        moved = value.detach().clone().requires_grad_(True)
        optimiser = torch.optim.AdamW([moved], lr=RATE)
        began = time.perf_counter()
        with torch.enable_grad():
            for _ in range(EMBEDDING_STEPS):
                optimiser.zero_grad()
                (-guide.log_prob(step.at(moved)).sum()).backward()
                optimiser.step()
        if isinstance(guide, _Timed):
            guide.seconds = time.perf_counter() - began
        return list(moved.detach().split(lengths, dim=1))


def bench_control(
    generator: MSCoT,
    data: str | Path,
    clips: int = 2,
    methods: Sequence[str] = METHODS,
    joints: Sequence[str] = JOINTS,
    densities: Sequence[str] = tuple(DENSITIES),
    seed: int = 0,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Every method on every case, in turn, at batch 1; texts are encoded before the clock starts.

    Args:
        generator: whose tokens and decoder all methods share.
        data: folder of the motion collection.
        clips: test clips of 64 frames or more for each joint and density.
        methods, joints, densities: those of the module's constants that shall run.
        seed: of clips, frames and motions.
        progress: called with what is being done and the fraction done.

    Raises:
        UserError: a method, joint or density that is not known, or no clip.

    Returns:
        ``{"summary", "rows"}``: a row for each method and case, and for the same sample without control
        (`uncontrolled`); seconds, decoder passes, metres. The summary has medians of times and passes and means of
        everything else, by method and density, medians of times of 196 frames alone where there are any, and ratios of
        medians to the paper's.
    """
    for given, known in ((methods, METHODS), (joints, JOINTS), (densities, DENSITIES)):
        for name in given:
            if name not in known:
                raise UserError(f"unknown '{name}'{did_you_mean(name, known)}")
    tell = progress or (lambda what, done: None)
    generator = MSCoT(replace(generator.bundle, text=_Remembered(generator.bundle.text)), generator.sampling)
    cases = list(_cases(data, clips, joints, densities, seed))
    ways = _ways(generator, cases, methods, tell)
    rows = []
    for i, case in enumerate(cases):
        tell(f"{case.joint} {case.density}", i / len(cases))
        free = case.generate(generator, None).motion
        rows.append(_row("uncontrolled", case, free, free, 0.0, 0.0, 0))
        for name, way in ways.items():
            began = time.perf_counter()
            made, refining, passes = way(case)
            seconds = time.perf_counter() - began
            rows.append(_row(name, case, made.motion, made.unrefined or made.motion, seconds, refining, passes))
    return {"summary": _summary(rows, methods), "rows": rows}


def _cases(data: str | Path, clips: int, joints: Sequence[str], densities: Sequence[str], seed: int) -> Iterator[Case]:
    usable = usable_clips(data)
    draw = torch.Generator().manual_seed(seed)
    for joint in joints:
        for density in densities:
            for i in torch.randperm(len(usable), generator=draw)[:clips].tolist():
                frames, given = min(usable[i].frames, MAX_FRAMES), DENSITIES[density]
                number = max(1, round(given * frames)) if isinstance(given, float) else given
                at = torch.randperm(frames, generator=draw)[:number].sort().values
                yield Case(usable[i], joint, density, at, seed + i)


Way = Callable[[Case], tuple[Generation, float, int]]
"""Makes a case's motion; returns it with the seconds and the decoder passes of its refinement."""


def _ways(generator: MSCoT, cases: Sequence[Case], methods: Sequence[str], tell: Progress) -> dict[str, Way]:
    scales = generator.quantiser.scales
    plain = replace(generator.bundle, metric=None)  # others search in embeddings as they are
    rival, other = ControlMM(plain, generator.sampling), MSCoT(plain, generator.sampling)

    def solved(solver: SolverSettings, tolerance: float = TOLERANCE, by: MSCoT = other) -> Way:
        def way(case: Case) -> tuple[Generation, float, int]:
            guide = case.guide(solver, tolerance)
            timed = _Timed(guide)
            made = case.generate(by, timed)
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
        timed = _Timed(case.guide(SolverSettings(polish=False), 0.0))
        made = case.generate(rival, timed)
        return made, timed.seconds, scales * LOGIT_STEPS + EMBEDDING_STEPS

    ways: dict[str, Way] = {
        "paper": ascent(PAPER_STEP),
        "controlmm": controlmm,
        "adam": patient("adam"),
        "lbfgs": patient("lbfgs"),
        "scenectl": solved(SolverSettings(), by=generator),
    }
    if "paper-best-step" in methods:
        tell("the paper's best step", 0.0)
        ways["paper-best-step"] = ascent(_best_step(ascent, cases))
    return {name: ways[name] for name in methods}


def _best_step(ascent: Callable[[float], Way], cases: Sequence[Case]) -> float:
    def error(step: float) -> float:
        few = cases[:: max(1, len(cases) // 4)][:4]
        return statistics.fmean(float(_errors(case, ascent(step)(case)[0].motion).mean()) for case in few)

    return min(STEPS_TRIED, key=error)


def _row(method: str, case: Case, motion: Motion, before: Motion, seconds: float, refining: float, passes: int) -> Row:
    error = _errors(case, motion)
    others = [j for j in range(len(HUMANML3D.names)) if HUMANML3D.names[j] != case.joint]
    moved = (motion.joints - before.joints)[..., others, :].norm(dim=-1).mean()
    return {
        "method": method,
        "joint": case.joint,
        "density": case.density,
        "frames": case.real.frames,
        "seconds": seconds,
        "refine_seconds": refining,
        "passes": passes,
        "average_error_m": float(error.mean()),
        "location_error": float((error > FAILED).float().mean()),
        "moved_m": float(moved),
        "bone_error_m": float(bone_errors(motion).mean()),
        "max_acceleration_m_per_frame2": float(max_acceleration(motion[0])),
        "skating_ratio": float(skating_ratio(motion[0])),
    }


def _errors(case: Case, motion: Motion) -> Float[Tensor, " K"]:
    return (motion[0].joint(case.joint)[case.at] - case.wanted).norm(dim=-1)


_MEDIANS = ("seconds", "refine_seconds", "passes")


def _summary(rows: Sequence[Row], methods: Sequence[str]) -> dict[str, Any]:
    figures = [key for key, value in rows[0].items() if isinstance(value, float | int) and key != "frames"]
    found: dict[str, Any] = {"motions": sum(row["method"] == "uncontrolled" for row in rows)}
    for method in ("uncontrolled", *methods):
        mine = [row for row in rows if row["method"] == method]
        for key in figures:
            found[f"{method}_{key}"] = _middle(key, [row[key] for row in mine])
        for key in ("seconds", "refine_seconds"):  # timings are quoted for the longest motions
            if long := [row[key] for row in mine if row["frames"] == MAX_FRAMES]:
                found[f"{method}_{key}_at_{MAX_FRAMES}"] = statistics.median(long)
        for density in dict.fromkeys(row["density"] for row in mine):
            some = [row["average_error_m"] for row in mine if row["density"] == density]
            found[f"{method}_average_error_m_at_{density}"] = statistics.fmean(some)
    if {"paper", "scenectl"} <= set(methods):
        for key in _MEDIANS:
            found[f"paper_over_scenectl_{key}"] = found[f"paper_{key}"] / max(found[f"scenectl_{key}"], 1e-9)
    return found


def _middle(key: str, values: Sequence[float | int]) -> float:
    return float(statistics.median(values) if key in _MEDIANS else statistics.fmean(values))


def plot(result: Mapping[str, Any], png: str | Path) -> None:
    """Error against seconds, a point for each motion and method, to a picture."""
    from matplotlib.figure import Figure  # without pyplot, so that no window system is asked for

    figure = Figure(figsize=(8, 5), layout="constrained")
    axis = figure.subplots()
    for method in METHODS:
        mine = [row for row in result["rows"] if row["method"] == method]
        if mine:
            errors = [max(1000 * row["average_error_m"], 1e-3) for row in mine]
            axis.scatter([row["seconds"] for row in mine], errors, s=14, alpha=0.6, label=method)
    axis.set(xscale="log", yscale="log", xlabel="seconds, text encoding excluded", ylabel="average error, mm")
    axis.legend()
    axis.grid(alpha=0.3, which="both")
    with atomic_write(png) as file:
        figure.savefig(file, format=Path(png).suffix.lstrip(".") or "png", dpi=110)
