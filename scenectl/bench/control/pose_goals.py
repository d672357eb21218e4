"""Poses at random times of motions, and recordings that are followed past a pillar in their way."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from objectives import Context, Evaluated, Objective, Term
from scenectl.bench.control.keyframes import FLOOR, longest, usable_clips
from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.control import SolverSettings
from scenectl.data.corpus import Clip
from scenectl.data.features import FPS, canonicalise
from scenectl.generators.base import Generator
from scenectl.generators.spec import Spec
from scenectl.measures.believability.judge import Judge
from scenectl.measures.believability.verdict import Verdict
from scenectl.measures.metrics import Scorer
from scenectl.pipeline.generation import Made, make
from scenectl.tasks.schema import AVOID, PASSING
from scenes.body.body import DEFAULT_BODY
from scenes.errors import UserError
from scenes.mesh.primitives import Cylinder
from scenes.motion.motion import Motion, Pose2D
from scenes.world.scene import Scene

LIMBS = ("left_wrist", "right_wrist", "left_foot", "right_foot")
POSED, FOLLOWED, CARRIED = 0.01, 0.02, 0.05
"""Metres within which a pose is met, a clip is followed in the world, and relative to the pelvis near the pillar."""
CLEAR = 0.5
"""Metres from the pillar within which the clip holds relative to the pelvis."""
RADIUS = 0.15
"""Of the pillar, m."""
AWAY = 1.0
"""Metres from the pillar's axis at which clips begin and end at least."""
TOUCH = 0.001
"""Metres that a body may be in the pillar without touching it, at frames or between them: rounding of its samples."""


@dataclass(frozen=True)
class Asked:
    """Goals that a recording states, for a motion of the same caption and length.

    Attributes:
        clip: the recording.
        frames: of it that count, from the first.
        seed: of the motion.
    """

    clip: Clip
    frames: int
    seed: int

    @cached_property
    def real(self) -> Motion:
        """The recording, over the origin at first and facing +z."""
        return Motion(canonicalise(self.clip.joints[: self.frames]))

    @property
    def scene(self) -> Scene:
        """Where it happens."""
        return Scene.empty(FLOOR)

    @property
    def margin(self) -> float:
        """Metres that are kept from things."""
        return float(AVOID["margin"])

    @property
    def term(self) -> Term:
        """What is asked."""
        raise NotImplementedError

    def row(self, generator: Generator, solver: SolverSettings | None, samples: int) -> Row:
        """What became of it: of the samples, the first that is met and believable, or else met."""
        scene, began = self.scene, time.perf_counter()
        context = Context(scene, DEFAULT_BODY)
        avoid = Term.from_table({"use": "sdf_penetration", **AVOID, "margin": self.margin})
        objective = Objective((self.term, avoid))
        made = make(
            generator, self.clip.captions[0], self.real.seconds, Pose2D(), objective, context, solver=solver,
            samples=samples, seed=self.seed,
        )  # fmt: skip
        seconds, judge = time.perf_counter() - began, Judge(Scorer(scene))
        assert made.unrefined is not None and made.solution is not None
        ones = [slice(k, k + 1) for k in range(samples)]
        each = [replace(made, motion=made.motion[one], unrefined=made.unrefined[one]) for one in ones]
        verdicts = [judge.verdict(one.motion[0]) for one in each]
        figures = [self.figures(one, context, verdict) for one, verdict in zip(each, verdicts, strict=True)]
        best = max(range(samples), key=lambda k: (figures[k]["met"], verdicts[k].believable))
        verdict, unrefined = verdicts[best], each[best].unrefined
        assert unrefined is not None
        return {
            "clip": self.clip.id,
            "source": self.clip.source,
            "frames": self.frames,
            **figures[best],
            "believable": verdict.believable,
            "verdict": verdict.sentence,
            "guided_believable": judge.verdict(unrefined[0]).believable,
            "real_believable": Judge(Scorer(Scene.empty(FLOOR))).verdict(self.real).believable,
            "reason": made.solution.reasons[best],
            "passes": made.solution.evaluations,
            "seconds": seconds,
        }

    def figures(self, made: Made, context: Context, verdict: Verdict) -> Row:
        """How nearly it was met."""
        raise NotImplementedError


@dataclass(frozen=True)
class Poses(Asked):
    """A recording's poses at some of its frames, relative to the pelvis or in the world."""

    at: Int[Tensor, " K"]
    frame: str

    @property
    def term(self) -> Term:
        poses = [self.real.joints[frame].tolist() for frame in self.at.tolist()]
        return Term("pose", {"pose": poses, "frame": self.frame}, at=[frame / FPS for frame in self.at.tolist()])

    def figures(self, made: Made, context: Context, verdict: Verdict) -> Row:
        assert made.unrefined is not None
        error, guided = (_errors(self.term.evaluate(m[0], context)) for m in (made.motion, made.unrefined))
        return {
            "mean_error_m": float(error.mean()),
            "worst_error_m": float(error.max()),
            "guided_worst_error_m": float(guided.max()),
            "met": bool(error.max() <= POSED),
        }


@dataclass(frozen=True)
class Followed(Asked):
    """All of a recording, with a pillar in its way.

    Attributes:
        pillar: where it stands, x and z.
    """

    pillar: tuple[float, float]

    @property
    def scene(self) -> Scene:
        x, z = self.pillar
        return Scene(primitives=[Cylinder((x, FLOOR + 1.0, z), RADIUS, 2.0)], floor=FLOOR, name="a pillar")

    @property
    def margin(self) -> float:
        return PASSING  # runs of 2.8 m/s have frames 14 cm apart

    @property
    def term(self) -> Term:
        return self._asked(None)

    def _asked(self, joints: Sequence[str] | None) -> Term:
        some = {} if joints is None else {"joints": list(joints)}
        return Term("like", {"clip": self.real, "frame": "world", "clear": CLEAR, **some})

    def figures(self, made: Made, context: Context, verdict: Verdict) -> Row:
        assert made.unrefined is not None
        found = self._asked(LIMBS).evaluate(made.motion[0], context)
        far, near = _parts(found)
        depths = Scorer(self.scene).depths(made.motion[0])
        depth = max(float(depths.obstacles.max()), verdict.figures["crossing_m"] or 0.0)
        return {
            "far_mean_m": float(far.mean()),
            "far_worst_m": float(far.max()),
            "near_worst_m": float(near.max()) if len(near) else 0.0,
            "near_frames": int((~_in_world(found)).sum()),
            "guided_worst_m": float(_errors(self._asked(LIMBS).evaluate(made.unrefined[0], context)).max()),
            "depth_m": depth,
            "untouched": depth <= TOUCH,
            "met": bool(far.max() <= FOLLOWED and (not len(near) or near.max() <= CARRIED) and depth <= TOUCH),
        }


def bench_pose_goals(
    generator: Generator,
    data: str | Path,
    motions: int = 30,
    clips: int = 10,
    times: int = 5,
    frame: str = "pelvis",
    samples: int = 1,
    seed: int = 0,
    solver: SolverSettings | None = None,
    engine: Engine = ENGINE,
) -> Result:
    """`pose` at random times of test clips, and `like` on test clips with a pillar in their way.

    Args:
        generator: what makes the motions.
        data: folder of the motion collection.
        motions: test clips whose poses are asked for.
        clips: test clips that are followed; those that go somewhere.
        times: of each motion, at random frames.
        frame: of poses, "pelvis" or "world".
        samples: made of each, of which the first counts that is met and believable, or else met.
        seed: of clips, frames and motions.
        solver: instead of the default.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary": ..., "rows": ...}``; metres, seconds, ratios.
    """
    settings = {"bench": "pose_goals", "data": data, "motions": motions, "clips": clips, "times": times}
    return engine.run(
        _cases(generator.spec, data, motions, clips, times, frame, seed),
        lambda asked: [{"goal": asked.term.goal, **asked.row(generator, solver, samples)}],
        _summary,
        {**settings, "frame": frame, "samples": samples, "seed": seed, "solver": solver},
    )


def _cases(
    spec: Spec, data: str | Path, motions: int, clips: int, times: int, frame: str, seed: int
) -> Iterator[tuple[str, Asked]]:
    draw = torch.Generator().manual_seed(seed)
    usable = usable_clips(data, spec)
    for i, number in enumerate(torch.randperm(len(usable), generator=draw)[:motions].tolist()):
        frames = min(usable[number].frames, longest(spec))
        at = torch.randperm(frames, generator=draw)[:times].sort().values
        yield f"pose: {usable[number].id}", Poses(usable[number], frames, seed + i, at, frame)
    drawn = (usable[number] for number in torch.randperm(len(usable), generator=draw).tolist())
    found = 0
    for clip in drawn if clips else ():
        frames = min(clip.frames, longest(spec))
        pillar = _in_the_way(Followed(clip, frames, seed + found, (0.0, 0.0)).real)
        if pillar is not None:
            yield f"like: {clip.id}", Followed(clip, frames, seed + found, pillar)
            found += 1
        if found == clips:
            return
    if found < clips:
        raise UserError(f"'{data}' has only {found} test clips that go {2 * AWAY:g} m and more")


def _in_the_way(real: Motion) -> tuple[float, float] | None:
    """Where on its way a recording is furthest from where it begins and ends; None where that is too near."""
    pelvis = real.joint("pelvis")[:, ::2]
    away = torch.minimum((pelvis - pelvis[0]).norm(dim=-1), (pelvis - pelvis[-1]).norm(dim=-1))
    if float(away.max()) < AWAY:
        return None
    x, z = pelvis[int(away.argmax())].tolist()
    return x, z


def _errors(found: Evaluated) -> Float[Tensor, " E"]:
    """How far each joint is off, m, where it is asked for."""
    return found.square.sqrt()[found.mask]


def _in_world(found: Evaluated) -> Bool[Tensor, " T"]:
    """Frames at which joints are asked for in the world."""
    assert found.targets is not None
    return found.targets.isfinite().all(-1).any(-1)


def _parts(found: Evaluated) -> tuple[Float[Tensor, " E"], Float[Tensor, " N"]]:
    """How far joints are off in the world, and relative to the pelvis; m."""
    far = _in_world(found)[:, None] & found.mask
    error = found.square.sqrt()
    return error[far], error[found.mask & ~far]


def _summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    told: dict[str, Any] = {}
    for goal in ("pose", "like"):
        some = [row for row in rows if row["goal"] == goal]
        if not some:
            continue
        shares = [key for key, value in some[0].items() if isinstance(value, bool)]
        figures = [key for key in some[0] if key.endswith("_m")]
        told |= {f"{goal}_motions": len(some)}
        told |= {f"{goal}_{key}": statistics.fmean(row[key] for row in some) for key in shares}
        told |= {f"{goal}_{key}": statistics.median(row[key] for row in some) for key in figures}
        told |= {f"{goal}_median_seconds": statistics.median(row["seconds"] for row in some)}
    return told
