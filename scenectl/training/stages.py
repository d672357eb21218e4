"""Stages as data: what a family trains, in which order, and what becomes of it; and a run of them on one data folder.

A family states its plan once, as a `Training`. Nothing here knows a family: `command` runs any plan.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

from torch import nn

from scenectl.data.clips import ClipSet
from scenectl.data.sources import load_clips
from scenectl.networks.checkpoint import read_about, save_weights
from scenectl.networks.text import TextEncoder, load_text_encoder
from scenectl.training.card import write_card
from scenectl.training.loop import Loop, LoopSettings
from scenectl.training.placement import Placement
from scenectl.training.recipe import Recipe
from scenes.errors import UserError

R = TypeVar("R", bound=Recipe)

Figures = Mapping[str, Any]
"""What was measured, by name, as JSON holds it."""


@dataclass(frozen=True)
class Job:
    """On what a stage trains, and where.

    Attributes:
        data: clips, on the device.
        folder: holds the state, so that a killed training goes on.
        seed: of initial weights and of what is drawn.
        place: device and precision.
        cache: folder of prepared data, where text features are kept, too.
        start: puts finished weights into a loop that has not begun; None where it begins at random ones.
    """

    data: ClipSet
    folder: Path
    seed: int
    place: Placement
    cache: Path | None = None
    start: Callable[[Loop], None] | None = None

    def loop(self, module: nn.Module, settings: LoopSettings) -> Loop:
        """The loop that trains a module, as far as it has come."""
        loop = Loop(module, settings, self.folder, self.seed, self.place)
        if self.start is not None and loop.iteration == 0:
            self.start(loop)
        return loop


@dataclass(frozen=True)
class Stage:
    """One stage of a training; the recipe's table of the same name holds its settings, with a `loop` among them.

    Attributes:
        name: of the stage, of its table, and of its folder in a run.
        build: the module that it trains, untrained, for the recipe's `model`.
        train: trains that module, or goes on, with these settings, as the job says.
        needs: stages whose results it reads; those that a recipe leaves out count as finished.
        reads_text: it needs the text encoder.
        report: lines of the model card about the finished loop.
    """

    name: str
    build: Callable[[Any], nn.Module]
    train: Callable[[Run[Any], Any, Job], Loop]
    needs: tuple[str, ...] = ()
    reads_text: bool = False
    report: Callable[[Loop], list[str]] = lambda loop: []


@dataclass(frozen=True)
class Comparison:
    """How a sweep compares variants of a recipe.

    Attributes:
        stage: the one that is trained for each variant.
        columns: figures of a variant's run, whose stage is finished.
        shortened: keys that change in a training of so many iterations, besides the length of every loop.
    """

    stage: str
    columns: Callable[[Run[Any]], Figures]
    shortened: Callable[[Any, int], Mapping[str, Any]] = lambda recipe, iterations: {}


@dataclass(frozen=True)
class Training(Generic[R]):
    """A family's plan.

    Attributes:
        recipe: its class of recipes: the networks' configuration, and a table for each stage (None: left out).
        stages: in the order in which "all" trains them.
        parts: the networks of the exported weights by file name, made of finished stages, on the CPU.
        manifest: writes the family's manifest into a folder, for its parts' files and what their headers say.
        measure: figures of the finished networks on the train and test splits.
        report: lines of the model card about those figures.
        measured: further parts by file name, measured on the exported ones in a folder.
        exported: the networks of exported weights, by the name of the stage that trained each.
        text: keys of the text encoder's name and width in the recipe; None where no stage reads text.
        comparison: of variants; None where the family has no sweep.
    """

    recipe: type[R]
    stages: tuple[Stage, ...]
    parts: Mapping[str, Callable[[Run[R]], nn.Module]]
    manifest: Callable[[Path, Mapping[str, Path], Mapping[str, Any]], None]
    measure: Callable[[Run[R], Mapping[str, nn.Module], ClipSet, ClipSet], Figures] = lambda run, parts, train, test: {}
    report: Callable[[Figures], list[str]] = lambda figures: []
    measured: Mapping[str, Callable[[Run[R], Path], nn.Module]] = field(default_factory=dict)
    exported: Callable[[str | Path], Mapping[str, nn.Module]] = lambda weights: {}
    text: tuple[str, str] | None = None
    comparison: Comparison | None = None

    def with_text(self, recipe: R, encoder: str) -> R:
        """The recipe with another text encoder, and networks of its width; raises UserError where none is read."""
        if self.text is None:
            raise UserError(f"generator '{recipe.family}' reads no text; train it without a text encoder")
        name, width = self.text
        return recipe.varied({name: encoder, width: load_text_encoder(encoder).dim})

    @property
    def commands(self) -> tuple[str, ...]:
        """What can be run by name: stages, "export", and what is measured on exported weights."""
        return (*(stage.name for stage in self.stages), "export", *self.measured)


@dataclass
class Run(Generic[R]):
    """One recipe on one data folder.

    Attributes:
        plan: of the family.
        recipe: networks, data and settings.
        data: folder of the motions.
        out: folder of the run; each stage's state lies in a folder of its own inside.
        iterations: instead of the recipe's, for every stage.
        where: device and precision; the CPU in float32 by default.
        weights: exported ones, by name or folder, whose networks stand for stages that this run has not trained.
        start: exported ones, at whose networks training begins; at random ones by default.
        cache: folder of prepared data, which runs can share; one inside `out` by default.
        stages: those that the recipe has settings for.
    """

    plan: Training[R]
    recipe: R
    data: Path
    out: Path
    iterations: int | None = None
    where: Placement = field(default_factory=Placement)
    weights: str | Path | None = None
    start: str | Path | None = None
    cache: Path | None = None

    def __post_init__(self) -> None:
        self._read = dict[str | Path | None, Mapping[str, nn.Module]]()
        self.stages = {each.name: each for each in self.plan.stages if getattr(self.recipe, each.name) is not None}

    @property
    def prepared(self) -> Path:
        """Folder of prepared data."""
        return self.cache or self.out / "data"

    def clips(self, splits: Sequence[str], augmented: bool) -> ClipSet:
        """Clips of some splits, with the recipe's augmentation or as they were recorded."""
        recipe = self.recipe
        augmentation = recipe.augmentation if augmented else None
        return load_clips(self.data, splits, augmentation, self.prepared, recipe.seed, recipe.commercial_only)

    def encoder(self, device: str | None = None) -> TextEncoder:
        """The text encoder, on the run's device or another; raises UserError where networks take another width."""
        assert self.plan.text is not None
        name, width = (self.recipe.value(key) for key in self.plan.text)
        encoder = load_text_encoder(name, device or self.where.device.type)
        if encoder.dim != width:
            key = self.plan.text[1].rpartition(".")[2]
            raise UserError(
                f"text encoder '{name}' gives features of {encoder.dim} numbers, and {key} in the "
                f"training config is {width}; set it to {encoder.dim}"
            )
        return encoder

    def train(self, name: str) -> Loop | None:
        """Train a stage, or go on; None where the recipe leaves it out.

        Raises:
            UserError: a stage that it needs is not finished.
        """
        if name not in self.stages:
            return None
        stage = self.stages[name]
        for other in stage.needs:
            if other in self.stages:
                self._check(other)
        settings = getattr(self.recipe, name)
        if self.iterations is not None:
            loop = settings.loop.model_copy(update={"iterations": self.iterations})
            settings = settings.model_copy(update={"loop": loop})
        start = None if self.start is None else partial(self._take_over, name, self.start)
        data = self.clips(["train"], True).on(self.where.device)
        job = Job(data, self.out / name, self.recipe.seed, self.where, self.prepared, start)
        return stage.train(self, settings, job)

    def finished(self, name: str) -> Loop:
        """The loop of a stage as it was left, on the CPU; its `averaged` is the result.

        Raises:
            UserError: the stage has not been trained, or its state is another network's.
        """
        self._check(name)
        settings: LoopSettings = getattr(self.recipe, name).loop
        loop = Loop(self.stages[name].build(self.recipe.model), settings, self.out / name, self.recipe.seed)
        if not self._trained(name):
            assert self.weights is not None
            self._take_over(name, self.weights, loop)
        loop.averaged.eval()
        return loop

    def _take_over(self, name: str, weights: str | Path, loop: Loop) -> None:
        """Put a stage's network of exported weights into a loop; raises UserError where it is none of this config's."""
        try:
            loop.begin_at(self._networks(weights)[name].state_dict())
        except (KeyError, RuntimeError) as error:
            raise UserError(f"weights '{weights}' hold no {name} of this config's networks") from error

    def _networks(self, weights: str | Path | None) -> Mapping[str, nn.Module]:
        """Of exported weights, read once, by the stage that trained each."""
        if weights not in self._read:
            self._read[weights] = {} if weights is None else self.plan.exported(weights)
        return self._read[weights]

    def _trained(self, name: str) -> bool:
        return (self.out / name / "state.safetensors").is_file()

    def _check(self, name: str) -> None:
        if not self._trained(name) and name not in self._networks(self.weights):
            raise UserError(f"'{self.out / name}' holds no trained {name}; train that stage first")

    def export(self) -> None:
        """Write the averaged weights in half precision, their manifest, and the model card."""
        networks = {part: make(self) for part, make in self.plan.parts.items()}
        first = [part for part in networks if part in self.stages]
        loops = {name: self.finished(name) for name in dict.fromkeys([*first, *self.stages])}
        train, test, folder = self.clips(["train"], True), self.clips(["test"], False), self.out / "weights"
        licence, credits = train.terms()
        about = {"config": self.recipe.model.model_dump(mode="json"), "licence": licence, "credits": credits}
        for part, module in networks.items():
            save_weights(module, folder / f"{part}.safetensors", {**about, "part": part}, half=True)
        self._describe(about)
        for part in self.plan.measured:
            self.measure(part)
        figures = self.plan.measure(self, networks, train, test)
        remarks = [line for name, loop in loops.items() for line in self.stages[name].report(loop)]
        write_card(folder, self.recipe.name, train, loops, remarks, figures, self.plan.report(figures))

    def measure(self, part: str) -> None:
        """Measure a part on the exported ones, and write it beside them, in half precision."""
        folder = self.out / "weights"
        about = read_about(folder / f"{next(iter(self.plan.parts))}.safetensors")
        module = self.plan.measured[part](self, folder)
        save_weights(module, folder / f"{part}.safetensors", {**about, "part": part}, half=True)
        self._describe(about)

    def _describe(self, about: Mapping[str, Any]) -> None:
        folder = self.out / "weights"
        files = {part: folder / f"{part}.safetensors" for part in (*self.plan.parts, *self.plan.measured)}
        self.plan.manifest(folder, {part: file for part, file in files.items() if file.is_file()}, about)
