"""Training of our evaluator and of the classifier of kinds: real motions of the train split and their mirror images."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import torch
from jaxtyping import Int
from torch import Tensor

from scenectl.data.augment import Augmentation
from scenectl.data.clips import ClipSet, prepare
from scenectl.evaluation import contrastive, kinds
from scenectl.evaluation.contrastive import Contrastive, ContrastiveConfig
from scenectl.evaluation.kinds import KindClassifier
from scenectl.evaluation.motions import LONGEST, SHORTEST, MotionEncoder, Padded
from scenectl.networks.checkpoint import save_weights
from scenectl.networks.text import load_text_encoder
from scenectl.training.captions import Captions
from scenectl.training.loop import Figures, Loop, LoopSettings
from scenes.tables import Table

MIRRORED = Augmentation.none(mirror=True, repeat=1.0)


class EvaluatorTraining(Table):
    """Settings of both trainings.

    Attributes:
        contrastive, kinds: length and speed of each.
        shortest: share of a clip that a training sample shows at least.
        noise: standard deviation added to normalised features: without it the networks overfit on few clips.
    """

    contrastive: LoopSettings = LoopSettings(iterations=600, batch=96, learning_rate=1e-3, weight_decay=0.05)
    kinds: LoopSettings = LoopSettings(iterations=500, batch=96, learning_rate=1e-3, weight_decay=0.05)
    shortest: float = 0.7
    noise: float = 0.1


def train_evaluator(data: Path, out: Path, seed: int = 0, settings: EvaluatorTraining | None = None) -> Path:
    """Train, or go on training, both networks in `out`; returns the folder with their weights.

    Args:
        data: folder of the motion collection.
        out: folder of the run.
        seed: of initial weights and of what is drawn.
        settings: lengths and speeds.
    """
    settings = settings or EvaluatorTraining()
    clips = prepare(data, ["train"], MIRRORED, out / "data", seed)
    whole, folder = _Whole(clips, settings), out / "weights"
    licence, credits = clips.terms()
    for task, loop in (
        (_contrastive(whole, seed, out / "data"), settings.contrastive),
        (_kinds(whole, seed), settings.kinds),
    ):
        name = Path(task.file).stem
        trained = _train(task, whole, loop, out / name, seed).averaged
        about = {"config": task.config, "licence": licence, "credits": credits, "part": name}
        save_weights(trained, folder / task.file, about, half=True)
    return folder


@dataclass
class _Whole:
    """Draws clips nearly whole, each kind of motion with the square root of its size."""

    data: ClipSet
    settings: EvaluatorTraining

    def __post_init__(self) -> None:
        self.clips = (self.data.lengths >= SHORTEST).nonzero()[:, 0]
        names = [self.data.groups[i] for i in self.clips.tolist()]
        counts = torch.tensor([float(names.count(name)) for name in names])
        self.weights = counts.rsqrt()
        self.std = self.data.statistics()[1]

    def draw(self, batch: int, generator: torch.Generator) -> tuple[Padded, Int[Tensor, " B"]]:
        chosen = self.clips[torch.multinomial(self.weights, batch, replacement=True, generator=generator)]
        share, place = torch.rand(2, batch, generator=generator)
        whole = self.data.lengths[chosen].clamp_max(LONGEST)
        length = (whole * torch.lerp(torch.tensor(self.settings.shortest), torch.tensor(1.0), share)).long()
        first = self.data.starts[chosen] + (place * (self.data.lengths[chosen] - length + 1)).long()
        rows = [self.data.features[a : a + n] for a, n in zip(first.tolist(), length.tolist(), strict=True)]
        noise = self.settings.noise
        noisy = [row + noise * self.std * torch.randn(row.shape, generator=generator) for row in rows]
        return Padded.of(noisy), chosen


class _Task(NamedTuple):
    """A network to train: its file, its motion encoder, its description, and what its loss compares clips with."""

    file: str
    model: Contrastive | KindClassifier
    encoder: MotionEncoder
    config: dict[str, Any]
    wanted: Callable[[Int[Tensor, " B"], torch.Generator], Tensor]


def _contrastive(whole: _Whole, seed: int, cache: Path) -> _Task:
    config = ContrastiveConfig()
    captions = Captions(whole.data, load_text_encoder(config.text), cache)
    torch.manual_seed(seed)  # initial weights belong to the run's seed
    model = Contrastive(config)

    def wanted(clips: Int[Tensor, " B"], draw: torch.Generator) -> Tensor:
        return captions.of_clips(clips, draw).sentence[:, 0]

    return _Task(contrastive.FILE, model, model.motion, config.model_dump(mode="json"), wanted)


def _kinds(whole: _Whole, seed: int) -> _Task:
    names = sorted({whole.data.groups[i] for i in whole.clips.tolist()})
    wanted = torch.tensor([names.index(group) if group in names else -1 for group in whole.data.groups])
    torch.manual_seed(seed)  # initial weights belong to the run's seed
    model = KindClassifier(names)
    return _Task(kinds.FILE, model, model.encoder, model.config, lambda clips, _: wanted[clips])


def _train(task: _Task, whole: _Whole, settings: LoopSettings, folder: Path, seed: int) -> Loop:
    mean, std = whole.data.statistics()
    task.encoder.mean.copy_(mean)
    task.encoder.std.copy_(std)
    loop = Loop(task.model, settings, folder, seed)

    def step(_: int, generator: torch.Generator) -> tuple[Tensor, Figures]:
        batch, clips = whole.draw(settings.batch, generator)
        return task.model.loss(batch, task.wanted(clips, generator)), {}

    loop.run(step)
    return loop
