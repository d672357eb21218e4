"""Generators: text in, drafts of motions out, each family in a folder behind the protocol of `base`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from scenectl.generators.registry import DEFAULT, find
from scenectl.threads import use
from scenes.errors import UserError, did_you_mean
from scenes.validation import sentence

if TYPE_CHECKING:
    from scenectl.generators.base import Generator

__all__ = ["load_generator"]


def load_generator(
    name: str = DEFAULT, weights: str | Path = "default", threads: int | None = None, **sampling: Any
) -> Generator:
    """Load a generator.

    Args:
        name: of a registered family (`scenectl.generators.registry`).
        weights: name of bundled weights, or a folder; "default" is the family's own.
        threads: of the CPU that torch uses from now on; by default one while motions are made (`scenectl.threads`).
        sampling: the family's settings (for MSCoT: `cfg`, `cfg_coarsest`, `temperature`, `top_p`, `clip_nats`,
            `clip_coarsest`).

    Raises:
        UserError: unknown generator or setting, missing or damaged weights.
    """
    from scenectl.generators.weights import open_weights

    family = find(name)
    fields = family.settings.model_fields
    for key in sampling:
        if key not in fields:
            raise UserError(f"generator '{name}': unknown setting '{key}'{did_you_mean(key, fields)}")
    try:
        settings = family.settings(**sampling)
    except ValidationError as error:
        raise UserError(f"generator '{name}': {sentence(error, sampling, family.settings)}") from error
    if threads is not None:
        use(threads)
    return family.open(open_weights(family, weights), settings)
