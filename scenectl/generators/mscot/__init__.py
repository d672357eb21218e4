"""MSCoT: multi-scale tokens, each scale's posterior tilted towards the goals (see `sampling`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from scenectl.generators.mscot.settings import SPEC, Sampling
from scenectl.generators.registry import Family

if TYPE_CHECKING:
    from scenectl.generators.mscot.sampling import MSCoT
    from scenectl.generators.weights import Weights


def _open(weights: Weights, settings: Sampling) -> MSCoT:
    from scenectl.generators.mscot.bundle import load_bundle  # networks, which those who only ask need not import
    from scenectl.generators.mscot.sampling import MSCoT

    return MSCoT(load_bundle(weights), settings)


FAMILY = Family("mscot", SPEC, Sampling, _open, training="scenectl.generators.mscot.training.stages:TRAINING")
