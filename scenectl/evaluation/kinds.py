"""Classifiers of kinds of motion, trained and then frozen: does a sample show what was asked for?"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor, nn

from scenectl.evaluation import SHIPPED
from scenectl.evaluation.motions import EncoderConfig, MotionEncoder, Padded
from scenectl.networks.checkpoint import load_network

FILE, ACTS = "kinds.safetensors", "acts.safetensors"
"""The first classifier knows the kinds that are recorded, and never saw a clip that was made; the second one knows
found and edited kinds too, and reads short windows."""
WINDOWS = (1.6, 2.0, 2.5)
"""Seconds of the windows in which the second classifier looks for acts within a motion."""
ENOUGH = 5
"""Test clips from which on a kind's recall is counted."""
ALONE = 10
"""Test clips from which on a kind stands in a row of its own; rarer ones share one."""


class KindClassifier(nn.Module):
    """Logits of named kinds for padded batches of motions."""

    def __init__(self, kinds: Sequence[str], width: int = 128, depth: int = 2, dropout: float = 0.3) -> None:
        super().__init__()
        self.kinds = tuple(kinds)
        self.config = {"kinds": list(kinds), "width": width, "depth": depth, "dropout": dropout}
        self.encoder = MotionEncoder(EncoderConfig(width=width, depth=depth, out=len(kinds), dropout=dropout))

    def forward(self, batch: Padded) -> Float[Tensor, "B K"]:
        out: Tensor = self.encoder(batch)
        return out

    def loss(self, batch: Padded, wanted: Int[Tensor, " B"]) -> Float[Tensor, ""]:
        """Cross-entropy with a little smoothing: labels of neighbouring kinds overlap."""
        return F.cross_entropy(self(batch), wanted, label_smoothing=0.05)

    @torch.no_grad()
    def predict(self, motions: Sequence[Float[Tensor, "_T 263"]]) -> list[str]:
        """The likeliest kind of each motion, raw features of at least four frames."""
        self.eval()
        logits = [self(Padded.of(motions[i : i + 64])) for i in range(0, len(motions), 64)]
        return [self.kinds[i] for i in torch.cat(logits).argmax(-1).tolist()]


@dataclass(frozen=True)
class Confusion:
    """Which kinds were taken for which.

    Attributes:
        kinds: of rows (true) and columns (predicted).
        counts: ``[K, K]``.
    """

    kinds: tuple[str, ...]
    counts: Int[Tensor, "K K"]

    @classmethod
    def of(cls, true: Sequence[str], predicted: Sequence[str]) -> Confusion:
        """Count pairs; kinds are all that occur on either side, in alphabetical order."""
        kinds = sorted({*true, *predicted})
        pairs = Counter(zip(true, predicted, strict=True))
        return cls(tuple(kinds), torch.tensor([[pairs[t, p] for p in kinds] for t in kinds]))

    @classmethod
    def joined(cls, parts: Sequence[Confusion]) -> Confusion:
        """Counts of several, added up."""
        kinds = sorted({kind for part in parts for kind in part.kinds})
        counts = torch.zeros(len(kinds), len(kinds), dtype=torch.long)
        for part in parts:
            at = torch.tensor([kinds.index(kind) for kind in part.kinds], dtype=torch.long)
            counts[at[:, None], at] += part.counts
        return cls(tuple(kinds), counts)

    def recall(self, enough: int = ENOUGH) -> dict[str, float]:
        """Share of each kind that was recognised, for kinds with enough clips."""
        total = self.counts.sum(1)
        return {
            kind: float(self.counts[i, i] / total[i]) for i, kind in enumerate(self.kinds) if int(total[i]) >= enough
        }

    def recall_of(self, kinds: Iterable[str]) -> float | None:
        """Share of all clips of these kinds that was recognised; None where there is none."""
        wanted = set(kinds)
        rows = [i for i, kind in enumerate(self.kinds) if kind in wanted]
        total = int(self.counts[rows].sum())
        return int(self.counts[rows, rows].sum()) / total if total else None

    @property
    def clips(self) -> dict[str, int]:
        """Of each true kind, how many there are."""
        return {kind: n for kind, n in zip(self.kinds, self.counts.sum(1).tolist(), strict=True) if n}

    @property
    def macro_recall(self) -> float:
        """Mean over kinds of their recall, each kind counting the same."""
        found = list(self.recall().values())
        return sum(found) / len(found) if found else 0.0


def load_classifier(folder: str | Path = SHIPPED, file: str = FILE) -> KindClassifier:
    """A frozen classifier from a folder: the first one (`FILE`) or the second (`ACTS`); the one that ships by default.

    Raises:
        UserError: weights are missing, damaged, or of another network.
    """
    return load_network(Path(folder) / file, lambda config: KindClassifier(**config), "classifier")
