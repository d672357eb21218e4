"""What scores generated motions against texts and real motions: one interface, whatever network is behind it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor

from scenes.errors import UserError, did_you_mean

EVALUATORS = ("own", "guo")


@runtime_checkable
class Evaluator(Protocol):
    """Texts and motions as points of one space. Figures of different evaluators cannot be compared.

    Attributes:
        name: stands in every table.
    """

    name: str

    def embed_motions(self, motions: Sequence[Float[Tensor, "_T 263"]]) -> Float[Tensor, "N d"]:
        """One point for each motion, given as raw features."""
        ...

    def embed_texts(self, captions: Sequence[str]) -> Float[Tensor, "N d"]:
        """One point for each caption."""
        ...


def load_evaluator(name: str = "own", folder: str | Path | None = None) -> Evaluator:
    """An evaluator by name.

    Args:
        name: "own", the contrastive model that ships, or "guo", the public one of Guo et al. (CVPR 2022).
        folder: where its weights lie; "guo" needs one, as its weights may not be shipped.

    Raises:
        UserError: unknown name, missing or damaged weights.
    """
    if name == "own":
        from scenectl.evaluation.contrastive import load_contrastive

        return load_contrastive(folder) if folder else load_contrastive()
    if name == "guo":
        if folder is None:
            raise UserError("evaluator 'guo' needs --evaluator-folder, where its weights lie; they may not be shipped")
        from scenectl.evaluation.guo import load_guo

        return load_guo(folder)
    raise UserError(f"unknown evaluator '{name}'{did_you_mean(name, EVALUATORS)}")
