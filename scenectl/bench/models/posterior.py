"""How far the first-order token posterior is from the exact one, scale by scale (Tables 12 and 13)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from objectives import Context, Objective, Term
from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.control import ObjectiveGuide
from scenectl.generators.base import Generator, Guide
from scenectl.generators.mscot.posterior import Scale, clipped, exact_tilt, tilted
from scenectl.generators.mscot.sampling import MSCoT
from scenectl.generators.mscot.schedule import tokens_for
from scenes.body.body import DEFAULT_BODY
from scenes.errors import UserError
from scenes.motion.motion import Pose2D
from scenes.world.scene import Scene

PROMPTS = (
    "a person walks forward",
    "a person walks forward and turns left",
    "a person runs forward",
    "a person waves with the right hand",
)
KEYFRAMES = 5
SECONDS = 3.2


@dataclass(frozen=True)
class _Case:
    """One generation that is looked at.

    Attributes:
        prompt: its sentence.
        seed: its own.
        other: seed of the motion from which its keyframes are.
        frames: of the keyframes.
        positions: token positions that are compared, at each scale.
    """

    prompt: str
    seed: int
    other: int
    frames: list[int]
    positions: list[list[int]]


def bench_posterior(
    generator: Generator, generations: int = 8, positions: int = 1, seed: int = 0, engine: Engine = ENGINE
) -> Result:
    """Compare both posteriors at random positions of every scale, five pelvis keyframes being pursued.

    The exact posterior decodes every code at one position, the others at their means (Eq. 9). The keyframes are those
    of another sample of the same prompt, so that they can be met. The tilt counts as generation uses it: with the
    guide's strength, and clipped (`Sampling.clip_nats`), the exact one no less than its approximation.

    Args:
        generator: an MSCoT model; others have no codes.
        generations: motions, with each prompt in turn.
        positions: positions compared at each scale.
        seed: of motions, keyframes and positions.
        engine: tells progress, keeps rows and goes on from them.

    Raises:
        UserError: the generator is no MSCoT model.

    Returns:
        ``{"summary": ..., "rows": ...}``, a row for each scale: its positions, KL(exact || first-order) in nats as
        generation uses them and without any clipping, and the largest distance of a code from the expansion point.
        The summary averages over token positions, as the paper does.
    """
    if not isinstance(generator, MSCoT):
        raise UserError(f"generator '{generator.name}' has no token posterior to compare")
    found = engine.run(
        [("posteriors", case) for case in _cases(generator, generations, positions, seed)],
        partial(_measured, generator),
        lambda rows: _summary(_by_scale(rows)),
        {"bench": "posterior", "generations": generations, "positions": positions, "seed": seed},
    )
    return found if "left" in found else {**found, "rows": _by_scale(found["rows"])}


def _cases(generator: MSCoT, generations: int, positions: int, seed: int) -> Iterator[_Case]:
    draw, length = torch.Generator().manual_seed(seed), generator.spec.frames(SECONDS)
    tokens = generator.quantiser.lengths(tokens_for(length))
    for i in range(generations):
        frames = 1 + torch.randperm(length - 1, generator=draw)[:KEYFRAMES]
        at = [torch.randint(n, (positions,), generator=draw).tolist() for n in tokens]
        yield _Case(PROMPTS[i % len(PROMPTS)], seed + i, seed + 1000 + i, frames.tolist(), at)


def _measured(generator: MSCoT, case: _Case) -> list[Row]:
    """A row for each position that is compared."""
    rows: list[Row] = []

    def compared(scale: Scale, guide: Guide) -> Tensor:
        for at in case.positions[scale.k]:
            about = {"scale": scale.k + 1.0, "positions": float(scale.prior.shape[1])}
            rows.append({**about, **_compare(scale, guide, at)})
        return tilted(scale, guide)

    guide = ObjectiveGuide(_keyframes(generator, case), Context(Scene.empty(), DEFAULT_BODY))
    observed = MSCoT(generator.bundle, generator.sampling, compared)
    observed.generate(case.prompt, SECONDS, Pose2D(), guide=guide, seed=case.seed)
    return rows


def _keyframes(generator: MSCoT, case: _Case) -> Objective:
    """Five pelvis positions of another sample of the same prompt."""
    other = generator.generate(case.prompt, SECONDS, Pose2D(), seed=case.other).motion
    places = other.joint("pelvis")[0]
    return Objective(
        tuple(
            Term("joint_target", {"joint": "pelvis", "position": places[frame].tolist()}, at=frame / other.fps)
            for frame in case.frames
        )
    )


@torch.no_grad()
def _compare(scale: Scale, guide: Guide, at: int) -> dict[str, float]:
    prior, first = scale.prior[:, at], scale.first_order(guide)[:, at]
    exact, nats = exact_tilt(scale.step, guide, scale.codes, at), scale.nats[:, None]
    distance = (scale.codes - scale.step.value[0, at]).norm(dim=-1).max()
    return {
        "kl_nats": _kl(prior + clipped(exact, nats), prior + clipped(first, nats)),
        "kl_unclipped_nats": _kl(prior + exact, prior + first),
        "code_distance": float(distance),
    }


def _kl(exact: Float[Tensor, "S V"], approximate: Float[Tensor, "S V"]) -> float:
    exact = exact.log_softmax(-1)
    return float((exact.exp() * (exact - approximate.log_softmax(-1))).sum(-1).mean())


def _by_scale(rows: Sequence[Row]) -> list[Row]:
    """Means over the generations and positions of each scale."""
    scales = sorted({row["scale"] for row in rows})
    grouped = [[row for row in rows if row["scale"] == scale] for scale in scales]
    return [{key: sum(row[key] for row in here) / len(here) for key in here[0]} for here in grouped]


def _summary(rows: Sequence[Row]) -> dict[str, float]:
    total = sum(row["positions"] for row in rows)
    keys = ("kl_nats", "kl_unclipped_nats", "code_distance")
    return {key: sum(row[key] * row["positions"] for row in rows) / total for key in keys}
