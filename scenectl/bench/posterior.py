"""How far the first-order token posterior is from the exact one, scale by scale (Tables 12 and 13)."""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from objectives import Context, Objective, Term
from scenectl.control import ObjectiveGuide, SolverSettings
from scenectl.generators.base import Progress
from scenectl.generators.mscot import MSCoT, Tilt, clipped, exact_tilt
from scenes.body import DEFAULT_BODY
from scenes.errors import UserError
from scenes.motion import Pose2D
from scenes.scene import Scene

PROMPTS = ("a person walks forward", "a person waves with the right hand", "a person runs and turns left")
TARGETS: tuple[tuple[str, list[float]], ...] = (
    ("pelvis", [0.3, 0.9, 1.5]),
    ("right_wrist", [-0.4, 1.3, 0.6]),
    ("left_foot", [0.4, 0.2, 1.0]),
)
SECONDS = 3.2


def bench_posterior(
    generator: MSCoT, generations: int = 6, positions: int = 1, seed: int = 0, progress: Progress | None = None
) -> dict[str, Any]:
    """Compare both posteriors at random positions of every scale while joint targets are pursued.

    The exact posterior decodes every code at one position, the others at their means (Eq. 9).

    Args:
        generator: an MSCoT model; others have no codes.
        generations: motions, each with a prompt and a target in turn.
        positions: positions compared at each scale.
        seed: of motions and positions.
        progress: called with what is being done and the fraction done.

    Returns:
        ``{"summary": ..., "rows": ...}``, a row for each scale: KL(exact || approximate) in nats of the tilt as it
        is and as it is clipped, and the largest distance of a code from the expansion point.
    """
    if not isinstance(generator, MSCoT):
        raise UserError(f"generator '{generator}' has no token posterior to compare")
    tell = progress or (lambda what, done: None)
    draw = torch.Generator().manual_seed(seed)
    found: list[dict[str, float]] = []
    for i in range(generations):
        tell("posteriors", i / generations)
        joint, position = TARGETS[(i // len(PROMPTS)) % len(TARGETS)]
        term = Term("joint_target", {"joint": joint, "position": position}, at=SECONDS - 0.1)
        guide = ObjectiveGuide(Objective((term,)), Context(Scene.empty(), DEFAULT_BODY), SolverSettings(iterations=0))

        def look(tilt: Tilt, guide: ObjectiveGuide = guide) -> None:
            for at in torch.randint(tilt.prior.shape[1], (positions,), generator=draw).tolist():
                found.append({"scale": tilt.k + 1, **_compare(tilt, guide, at, generator.sampling.clip_nats)})

        observed = MSCoT(generator.bundle, generator.sampling, look)
        observed.generate(PROMPTS[i % len(PROMPTS)], SECONDS, Pose2D(), guide, 1, seed + i)
    rows = [_mean(found, k + 1) for k in range(generator.quantiser.scales)]
    keys = ("kl_nats", "kl_clipped_nats", "code_distance")
    return {"summary": {key: sum(row[key] for row in rows) / len(rows) for key in keys}, "rows": rows}


@torch.no_grad()
def _compare(tilt: Tilt, guide: ObjectiveGuide, at: int, clip: float) -> dict[str, float]:
    prior, first = tilt.prior[:, at], tilt.first_order[:, at]
    exact = (prior + exact_tilt(tilt.step, guide, tilt.codes, at)).log_softmax(-1)
    distance = (tilt.codes - tilt.step.value[0, at]).norm(dim=-1).max()
    return {
        "kl_nats": _kl(exact, prior + first),
        "kl_clipped_nats": _kl(exact, prior + clipped(first, clip)),
        "code_distance": float(distance),
    }


def _kl(exact: Float[Tensor, "S V"], approximate: Float[Tensor, "S V"]) -> float:
    return float((exact.exp() * (exact - approximate.log_softmax(-1))).sum(-1).mean())


def _mean(found: list[dict[str, float]], scale: int) -> dict[str, float]:
    here = [row for row in found if row["scale"] == scale]
    return {key: sum(row[key] for row in here) / len(here) for key in here[0]}
