"""MSCoT: multi-scale tokens, each scale's posterior tilted towards the goals (see `sampling`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from scenectl.data.features import FPS
from scenectl.generators.mscot.schedule import MAX_FRAMES, MIN_FRAMES
from scenectl.generators.mscot.settings import Sampling
from scenectl.generators.registry import Family
from scenectl.generators.spec import Spec

if TYPE_CHECKING:
    from scenectl.generators.mscot.sampling import MSCoT
    from scenectl.generators.weights import Weights

SPEC = Spec(
    fps=FPS,
    shortest=MIN_FRAMES / FPS,
    longest=60.0,  # beyond this a request is taken for a mistake; the schedule itself has no limit
    window=MAX_FRAMES / FPS,
    abilities=frozenset({"edit"}),
)


def _open(weights: Weights, settings: Sampling) -> MSCoT:
    from scenectl.generators.mscot.bundle import load_bundle  # networks, which those who only ask need not import
    from scenectl.generators.mscot.sampling import MSCoT

    return MSCoT(load_bundle(weights), settings)


FAMILY = Family("mscot", SPEC, Sampling, _open, training="scenectl.generators.mscot.training.stages:TRAINING")
