"""How far the first-order token posterior is from the exact one, scale by scale (Tables 12 and 13)."""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from objectives import Context, Objective, Term
from scenectl.control import ObjectiveGuide
from scenectl.generators.base import Generator, Guide, Progress, silent
from scenectl.generators.mscot.posterior import Scale, clipped, exact_tilt, tilted
from scenectl.generators.mscot.sampling import MSCoT
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


def bench_posterior(
    generator: Generator, generations: int = 8, positions: int = 1, seed: int = 0, progress: Progress = silent
) -> dict[str, Any]:
    """Compare both posteriors at random positions of every scale, five pelvis keyframes being pursued.

    The exact posterior decodes every code at one position, the others at their means (Eq. 9). The keyframes are those
    of another sample of the same prompt, so that they can be met. The tilt counts as generation uses it: with the
    guide's strength, and clipped (`Sampling.clip_nats`), the exact one no less than its approximation.

    Args:
        generator: an MSCoT model; others have no codes.
        generations: motions, with each prompt in turn.
        positions: positions compared at each scale.
        seed: of motions, keyframes and positions.
        progress: called with what is being done and the fraction done.

    Raises:
        UserError: the generator is no MSCoT model.

    Returns:
        ``{"summary": ..., "rows": ...}``, a row for each scale: its positions, KL(exact || first-order) in nats as
        generation uses them and without any clipping, and the largest distance of a code from the expansion point.
        The summary averages over token positions, as the paper does.
    """
    if not isinstance(generator, MSCoT):
        raise UserError(f"generator '{generator.name}' has no token posterior to compare")
    draw = torch.Generator().manual_seed(seed)
    found: list[dict[str, float]] = []

    def compared(scale: Scale, guide: Guide) -> Tensor:
        length = scale.prior.shape[1]
        for at in torch.randint(length, (positions,), generator=draw).tolist():
            found.append({"scale": scale.k + 1.0, "positions": float(length), **_compare(scale, guide, at)})
        return tilted(scale, guide)

    for i in range(generations):
        progress("posteriors", i / generations)
        prompt = PROMPTS[i % len(PROMPTS)]
        guide = _keyframes(generator, prompt, seed + 1000 + i, draw)

        MSCoT(generator.bundle, generator.sampling, compared).generate(
            prompt, SECONDS, Pose2D(), guide=guide, seed=seed + i
        )
    rows = [_mean(found, k + 1) for k in range(generator.quantiser.scales)]
    total = sum(row["positions"] for row in rows)
    keys = ("kl_nats", "kl_unclipped_nats", "code_distance")
    return {"summary": {key: sum(row[key] * row["positions"] for row in rows) / total for key in keys}, "rows": rows}


def _keyframes(generator: MSCoT, prompt: str, seed: int, draw: torch.Generator) -> ObjectiveGuide:
    """A guide to five pelvis positions of another sample of the same prompt."""
    other = generator.generate(prompt, SECONDS, Pose2D(), seed=seed).motion.joints[0, :, 0]
    frames = 1 + torch.randperm(len(other) - 1, generator=draw)[:KEYFRAMES]
    terms = tuple(
        Term("joint_target", {"joint": "pelvis", "position": other[frame].tolist()}, at=frame / generator.spec.fps)
        for frame in frames.tolist()
    )
    return ObjectiveGuide(Objective(terms), Context(Scene.empty(), DEFAULT_BODY))


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


def _mean(found: list[dict[str, float]], scale: int) -> dict[str, float]:
    here = [row for row in found if row["scale"] == scale]
    return {key: sum(row[key] for row in here) / len(here) for key in here[0]}
