"""Training of what evaluates, on the train split.

Our evaluator and the first classifier of kinds learn from real motions and their mirror images; the second classifier
from recorded, found and edited clips and from single acts of composed ones.
"""

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
from scenectl.data.features import FPS
from scenectl.evaluation import contrastive, kinds
from scenectl.evaluation.acts import COPIES, single_acts
from scenectl.evaluation.contrastive import Contrastive, ContrastiveConfig
from scenectl.evaluation.kinds import WINDOWS, KindClassifier
from scenectl.evaluation.motions import LONGEST, SHORTEST, MotionEncoder, Padded
from scenectl.networks.checkpoint import save_weights
from scenectl.networks.text import load_text_encoder
from scenectl.training.captions import Captions
from scenectl.training.loop import Figures, Loop, LoopSettings
from scenes.tables import Table

MIRRORED = Augmentation.none(mirror=True, repeat=1.0)


class EvaluatorTraining(Table):
    """Settings of the trainings.

    Attributes:
        contrastive, kinds, acts: length and speed of each.
        shortest: share of a clip that a training sample shows at least.
        windows: share of the second classifier's samples that are as short as `WINDOWS`.
        noise: standard deviation added to normalised features: without it the networks overfit on few clips.
    """

    contrastive: LoopSettings = LoopSettings(iterations=600, batch=96, learning_rate=1e-3, weight_decay=0.05)
    kinds: LoopSettings = LoopSettings(iterations=500, batch=96, learning_rate=1e-3, weight_decay=0.05)
    acts: LoopSettings = LoopSettings(iterations=1500, batch=96, learning_rate=1e-3, weight_decay=0.05)
    shortest: float = 0.7
    windows: float = 0.5
    noise: float = 0.1


def train_evaluator(data: Path, out: Path, seed: int = 0, settings: EvaluatorTraining | None = None) -> Path:
    """Train, or go on training, evaluator and first classifier in `out`; returns the folder with their weights.

    Args:
        data: folder of the motion collection.
        out: folder of the run.
        seed: of initial weights and of what is drawn.
        settings: lengths and speeds.
    """
    settings = settings or EvaluatorTraining()
    clips = prepare(data, ["train"], MIRRORED, out / "data", seed)
    whole = _Whole(clips, settings)
    both = (_contrastive(whole, seed, out / "data"), settings.contrastive), (_kinds(whole, seed), settings.kinds)
    for task, loop in both:
        _learn(task, whole, loop, out, seed)
    return out / "weights"


def train_acts(data: Path, out: Path, seed: int = 0, settings: EvaluatorTraining | None = None) -> Path:
    """Train, or go on training, the second classifier in `out`, as `train_evaluator` does the first."""
    settings = settings or EvaluatorTraining()
    clips = single_acts(prepare(data, ["train"], COPIES, out / "data", seed))
    whole = _Whole(clips, settings, round(WINDOWS[0] * FPS), settings.windows)
    _learn(_kinds(whole, seed, kinds.ACTS), whole, settings.acts, out, seed)
    return out / "weights"


@dataclass
class _Whole:
    """Draws clips nearly whole, or as short as windows, each kind of motion with the square root of its size.

    Attributes:
        data: all clips.
        settings: of the training.
        least: frames of the shortest clip that is drawn.
        windows: share of the samples that are as short as `WINDOWS`.
    """

    data: ClipSet
    settings: EvaluatorTraining
    least: int = SHORTEST
    windows: float = 0.0

    def __post_init__(self) -> None:
        self.clips = (self.data.lengths >= self.least).nonzero()[:, 0]
        names = [self.data.groups[i] for i in self.clips.tolist()]
        counts = torch.tensor([float(names.count(name)) for name in names])
        self.weights = counts.rsqrt()
        self.std = self.data.statistics()[1]

    def draw(self, batch: int, generator: torch.Generator) -> tuple[Padded, Int[Tensor, " B"]]:
        chosen = self.clips[torch.multinomial(self.weights, batch, replacement=True, generator=generator)]
        share, place = torch.rand(2, batch, generator=generator)
        whole = self.data.lengths[chosen].clamp_max(LONGEST)
        length = (whole * torch.lerp(torch.tensor(self.settings.shortest), torch.tensor(1.0), share)).long()
        if self.windows:
            short = FPS * (WINDOWS[0] + (WINDOWS[-1] - WINDOWS[0]) * torch.rand(batch, generator=generator))
            cut = torch.rand(batch, generator=generator) < self.windows
            length = torch.where(cut, torch.minimum(short.long(), whole), length)
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


def _kinds(whole: _Whole, seed: int, file: str = kinds.FILE) -> _Task:
    names = sorted({whole.data.groups[i] for i in whole.clips.tolist()})
    wanted = torch.tensor([names.index(group) if group in names else -1 for group in whole.data.groups])
    torch.manual_seed(seed)  # initial weights belong to the run's seed
    model = KindClassifier(names)
    return _Task(file, model, model.encoder, model.config, lambda clips, _: wanted[clips])


def _learn(task: _Task, whole: _Whole, settings: LoopSettings, out: Path, seed: int) -> None:
    """Train one network in a folder of its name, and write its weights."""
    name = Path(task.file).stem
    licence, credits = whole.data.terms()
    about = {"config": task.config, "licence": licence, "credits": credits, "part": name}
    trained = _train(task, whole, settings, out / name, seed).averaged
    save_weights(trained, out / "weights" / task.file, about, half=True)


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
