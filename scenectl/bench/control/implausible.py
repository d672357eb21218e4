"""Targets that no body can meet, or that are noise: does the motion stay a person's, and is the culprit named?"""

from __future__ import annotations

import re
import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from objectives import Objective, Term, diagnosis
from scenectl.bench.control.keyframes import FLOOR, ON_FLOOR, longest, usable_clips
from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.control import SolverSettings
from scenectl.control.refine.body_costs import BodyCosts
from scenectl.control.thresholds import THRESHOLDS
from scenectl.data.features import FPS, canonicalise
from scenectl.generators.base import Generator
from scenectl.generators.spec import Spec
from scenectl.measures.metrics import max_acceleration
from scenectl.pipeline.generation import make
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.skeleton import FEET

KINDS = ("too high", "under the floor", "too far", "torn apart", "noisy")
NOISE = 0.15
"""Standard deviation (m) of every coordinate of noisy targets."""
TOLERANCE = 0.01


@dataclass(frozen=True)
class _Ask:
    """Targets of a test motion, some of them spoilt.

    Attributes:
        culprits: numbers of the spoilt ones, from 1, by term; none where all are noise.
    """

    terms: tuple[Term, ...]
    culprits: tuple[tuple[str, int], ...]


@dataclass(frozen=True)
class _Case:
    """What is asked of a motion of a caption, instead of the recorded one."""

    kind: str
    caption: str
    real: Motion
    ask: _Ask
    seed: int


def bench_implausible(
    generator: Generator,
    data: str | Path,
    clips: int = 8,
    seed: int = 0,
    engine: Engine = ENGINE,
) -> Result:
    """Five keyframes of a wrist, a foot or the pelvis from a test motion, spoilt in one of `KINDS` of ways.

    Every case is made twice from one seed: with goals and the body's cost (`SolverSettings.natural`), and with goals
    alone, as the paper has it.

    Args:
        generator: what makes the motions.
        data: folder of the motion collection.
        clips: test clips for each kind.
        seed: of clips, frames and motions.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary", "rows"}``, a row for each case and way (`natural`, `goals alone`): how far (m) a foot is lifted
        that stood in the motion before refinement, and how deep (m) one is in the floor; by how much (m) the targets
        that are not spoilt are missed at worst, and the spoilt ones; and whether the diagnosis names a spoilt one.
    """
    return engine.run(
        _cases(generator.spec, data, clips, seed),
        lambda case: _measured(generator, case),
        _summary,
        {"bench": "implausible", "data": data, "clips": clips, "seed": seed},
    )


def _cases(spec: Spec, data: str | Path, clips: int, seed: int) -> Iterator[tuple[str, _Case]]:
    draw = torch.Generator().manual_seed(seed)
    usable = usable_clips(data, spec)
    usable = [clip for clip in usable if clip.source == "bandai"] or usable
    for kind in KINDS:
        for number, i in enumerate(torch.randperm(len(usable), generator=draw)[:clips].tolist()):
            real = Motion(canonicalise(usable[i].joints[: longest(spec)]))
            yield kind, _Case(kind, usable[i].captions[0], real, _asked(kind, real, draw), seed + number)


def _asked(kind: str, real: Motion, draw: torch.Generator) -> _Ask:
    at = torch.randperm(real.frames - 1, generator=draw)[:5].sort().values + 1
    joint = {"under the floor": "left_foot", "too far": "pelvis"}.get(kind, "left_wrist")
    wanted = real.joint(joint)[at].clone()
    spoilt = int(torch.randint(1, 4, (), generator=draw))  # never an end: that one has room on one side
    name = "joint_target"
    if kind == "noisy":
        wanted += NOISE * torch.randn(wanted.shape, generator=draw)
        return _Ask((_term(name, joint, wanted, at),), ())
    if kind == "torn apart":
        other = real.joint("right_wrist")[at[spoilt]][None] + torch.tensor([3.0, 0.0, 0.0])
        terms = (_term(name, joint, wanted, at), _term("right hand", "right_wrist", other, at[spoilt][None]))
        return _Ask(terms, ((name, spoilt + 1), ("right hand", 1)))
    wanted[spoilt] += torch.tensor(
        {"too high": [0.0, 2.5, 0.0], "under the floor": [0.0, -0.6, 0.0]}.get(kind, [4, 0, 0])
    )
    return _Ask((_term(name, joint, wanted, at),), ((name, spoilt + 1),))


def _term(name: str, joint: str, wanted: Float[Tensor, "K 3"], at: Tensor) -> Term:
    target = {"joint": joint, "position": wanted.tolist()}
    return Term("joint_target", target, tolerance=TOLERANCE, at=(at / FPS).tolist(), name=name)


def _measured(generator: Generator, case: _Case) -> list[Row]:
    objective, real, culprits = Objective(case.ask.terms), case.real, case.ask.culprits
    rows = []
    for way, settings in (("natural", SolverSettings()), ("goals alone", SolverSettings(natural=False))):
        began = time.perf_counter()
        made = make(
            generator, case.caption, real.seconds, Pose2D(), objective, ON_FLOOR, solver=settings, seed=case.seed
        )
        seconds = time.perf_counter() - began
        assert made.unrefined is not None and made.solution is not None
        natural = BodyCosts.beside(made.unrefined, objective, ON_FLOOR)
        sentence = diagnosis(objective, made.motion[0], ON_FLOOR) or ""
        soles = made.motion.select(FEET)[..., 1] - ON_FLOOR.body.sole_offset
        rows.append({
            "kind": case.kind,
            "way": way,
            "frames": real.frames,
            "ended": made.solution.reasons[0],
            "lift_m": float(natural.lift(made.motion)),
            "depth_m": float((FLOOR - soles).amax().clamp_min(0.0)),
            **_misses(case.ask, made.motion),
            "max_acceleration_m_per_frame2": float(max_acceleration(made.motion[0])),
            "named": not culprits or any(_names(sentence, *culprit) for culprit in culprits),
            "seconds": seconds,
            "diagnosis": sentence,
        })  # fmt: skip
    return rows


def _misses(ask: _Ask, motion: Motion) -> dict[str, float | None]:
    """By how much (m) a motion ``[1, T, J, 3]`` misses targets at worst: sound ones, and those that are spoilt."""
    found: dict[bool, list[float]] = {False: [], True: []}
    for term in ask.terms:
        evaluated = term.evaluate(motion[0], ON_FLOOR)
        for number, miss in enumerate(evaluated.square.sqrt()[evaluated.mask].tolist(), 1):
            found[(term.name, number) in ask.culprits].append(miss)
    return {"missed_m": max(found[False]), "spoilt_missed_m": max(found[True], default=None)}


def _names(sentence: str, term: str, number: int) -> bool:
    """Whether a diagnosis begins with that target."""
    which = r"the target" if term != "joint_target" else rf"target {number}\b"
    return re.match(rf"({re.escape(term)}: )?{which}", sentence) is not None


def _summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {"cases": len(rows) // 2}
    for way in ("natural", "goals alone"):
        mine = [row for row in rows if row["way"] == way]
        found[way] = {
            "lift_m": max(row["lift_m"] for row in mine),
            "feet_kept": _share(mine, lambda r: r["lift_m"] <= THRESHOLDS.lift),
            "mean_missed_m": statistics.fmean(row["missed_m"] for row in mine if row["kind"] != "noisy"),
            "others_met": _share([row for row in mine if row["kind"] != "noisy"], lambda r: r["missed_m"] <= TOLERANCE),
            "named": _share(mine, lambda r: r["named"]),
            "median_seconds": statistics.median(row["seconds"] for row in mine),
        }
    return found


def _share(rows: Sequence[Mapping[str, Any]], holds: Any) -> float:
    return statistics.fmean(bool(holds(row)) for row in rows)
