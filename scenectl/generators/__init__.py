"""Generators: text in, motions out, each behind the protocol of `base`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from scenectl.generators.base import Editor, Generation, Generator, Guide, Progress, Step
from scenes.errors import UserError, did_you_mean

__all__ = ["GENERATORS", "Editor", "Generation", "Generator", "Guide", "Progress", "Step", "load_generator"]

GENERATORS = ("mscot",)


def load_generator(
    name: str = "mscot", weights: str | Path = "default", threads: int | None = None, **sampling: Any
) -> Generator:
    """Load a generator.

    Args:
        name: one of `GENERATORS`.
        weights: name of bundled weights, or a folder.
        threads: CPU threads torch may use; None leaves its setting alone.
        sampling: settings of the generator (for MSCoT: `cfg`, `temperature`, `top_p`, `clip_nats`, `clip_coarsest`).

    Raises:
        UserError: unknown generator or setting, missing or damaged weights.
    """
    import torch

    from scenectl.generators.mscot.bundle import load_bundle
    from scenectl.generators.mscot.sampling import MSCoT, Sampling

    if name not in GENERATORS:
        raise UserError(f"unknown generator '{name}'{did_you_mean(name, GENERATORS)}")
    for key in sampling:
        if key not in Sampling.model_fields:
            raise UserError(f"generator '{name}': unknown setting '{key}'{did_you_mean(key, Sampling.model_fields)}")
    try:
        settings = Sampling(**sampling)
    except ValidationError as error:
        first = error.errors()[0]
        raise UserError(f"generator '{name}': {first['loc'][0]}: {first['msg'].lower()}") from error
    if threads is not None:
        torch.set_num_threads(threads)
    return MSCoT(load_bundle(weights), settings)
