"""What a step's products cost, in passes: one decodes a value and pulls one gradient back to it."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator

import torch
from jaxtyping import Float
from torch import Tensor

from objectives import Context, Objective, Term
from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.control import FreeStart, ObjectiveGuide
from scenectl.control.refine.polish import SmoothStep
from scenectl.control.start import MovedStep
from scenectl.generators.base import Generator, Guide, Step
from scenectl.generators.steps import DecodedStep
from scenes.body.body import DEFAULT_BODY
from scenes.motion.motion import Pose2D
from scenes.world.scene import Scene

PROMPT, SECONDS = "a person walks forward", 6.0
ROWS = (8, 48)
"""Cotangents at once."""


class _Seen(ObjectiveGuide):
    """A guide that keeps the last step it was shown."""

    step: Step | None = None

    def gradient(self, step: Step) -> Float[Tensor, "S *v"]:
        self.step = step
        return super().gradient(step)


def bench_prices(
    generator: Generator,
    repeats: int = 9,
    samples: int = 1,
    seed: int = 0,
    engine: Engine = ENGINE,
) -> Result:
    """Time a pass and products of every kind of step that a generator leads to.

    Args:
        generator: whose steps: the last that a guide sees and the one to be refined, linearised and by autograd; the
            same with its start, and smooth moves of what it decodes to.
        repeats: of each product, in turn; medians count.
        samples: motions at once.
        seed: of the motion.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary", "rows"}``: a row for each kind of step with the milliseconds of a pass, and in passes one `jvp`,
        one `vjp`, and one row of `vjps` at each number of `ROWS`, all at a value decoded already. `Price.product` is
        about the mean of the first two, `Price.row` the last.
    """
    settings = {"repeats": repeats, "samples": samples, "threads": torch.get_num_threads()}

    def row(case: tuple[str, Step]) -> list[Row]:
        kind, step = case
        return [{"step": kind, "states": f"{step.price.product:g}, {step.price.row:g}", **_priced(step, repeats)}]

    cases = [(f"prices: {kind}", (kind, step)) for kind, step in _steps(generator, samples, seed)]
    return engine.run(cases, row, lambda rows: settings, {"bench": "prices", "seed": seed, **settings})


def _steps(generator: Generator, samples: int, seed: int) -> Iterator[tuple[str, Step]]:
    goal = Term("joint_target", {"joint": "head", "position": [0.2, 1.5, 2.0]}, at=0.5 * SECONDS)
    guide = _Seen(Objective((goal,)), Context(Scene.empty(), DEFAULT_BODY))
    shown: Guide = guide
    draft = generator.generate(PROMPT, SECONDS, Pose2D(), guide=shown, samples=samples, seed=seed)
    if guide.step is not None:
        yield "guided", guide.step
    if draft.step is not None:
        step = draft.step
        yield "refined", step
        yield "refined, by autograd", DecodedStep(step.value, step.decode)
        still = step.value.new_zeros(samples, 3)
        yield "refined, with its start", MovedStep.of(step, FreeStart((0.0, 0.0, 0.0)), still)
    yield "smooth", SmoothStep.of(draft.motion)


def _priced(step: Step, repeats: int) -> dict[str, float]:
    joints = step.motion.joints
    tangent, cotangents = torch.randn_like(step.value), torch.randn(max(ROWS), *joints.shape).to(joints)

    def whole() -> None:
        value = step.value.detach().requires_grad_(True)
        with torch.enable_grad():
            torch.autograd.grad(step.decode(value).joints, value, cotangents[0])

    def product(take: Callable[[Step], Tensor]) -> Callable[[], float]:
        """Time at a value that is decoded already."""

        def timed() -> float:
            at = step.at(step.value.clone())
            _ = at.motion.joints
            return _timed(lambda: take(at))

        return timed

    measures: dict[str, Callable[[], float]] = {
        "pass": lambda: _timed(whole),
        "jvp": product(lambda at: at.jvp(tangent)),
        "vjp": product(lambda at: at.vjp(cotangents[0])),
        **{f"row_of_{n}": product(lambda at, n=n: at.vjps(cotangents[:n])) for n in ROWS},  # type: ignore[misc]
    }
    taken: dict[str, list[float]] = {name: [] for name in measures}
    for turn in range(repeats + 1):
        for name, measure in measures.items():
            seconds = measure()
            if turn:  # the first warms up
                taken[name].append(seconds)
    median = {name: statistics.median(seconds) for name, seconds in taken.items()}
    return {
        "pass_ms": 1e3 * median["pass"],
        "jvp": median["jvp"] / median["pass"],
        "vjp": median["vjp"] / median["pass"],
        **{f"row_of_{n}": median[f"row_of_{n}"] / n / median["pass"] for n in ROWS},
    }


def _timed(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    if torch.cuda.is_available():
        torch.cuda.synchronize()
    return time.perf_counter() - began
