"""A second family, of one linear network and one stage, is trained, resumed and exported by its plan alone."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Literal

import pytest
import torch
from pydantic import BaseModel
from torch import Tensor, nn

from scenectl.data.clips import ClipSet, beginnings
from scenectl.data.features import FEATURES
from scenectl.generators.registry import Family, forget, register
from scenectl.generators.spec import Spec
from scenectl.generators.training import manifest_of, plan_of
from scenectl.generators.weights import described
from scenectl.networks.checkpoint import load_weights
from scenectl.training import command
from scenectl.training.errors import error_by_source, source_table
from scenectl.training.loop import FRAMES, Figures, Loop
from scenectl.training.losses import ReconstructionTraining, reconstruction_loss
from scenectl.training.recipe import Recipe, load_recipe
from scenectl.training.stages import Comparison, Job, Run, Stage, Training
from scenectl.training.sweep import train_sweep
from scenes.errors import UserError
from tests.scenectl.training.folder import same, walks

RECIPE = """
family = "mirror"
seed = 2
[model]
name = "tiny mirror"
rank = 4
[network]
frames = [16, 32]
loop = { iterations = 6, batch = 4, warmup = 1, log_every = 2 }
[[sweep]]
name = "plain"
[[sweep]]
name = "narrow"
set = { "model.rank" = 1 }
"""


class MirrorConfig(BaseModel):
    name: str
    rank: int


class MirrorRecipe(Recipe):
    family: Literal["mirror"] = "mirror"
    model: MirrorConfig
    network: ReconstructionTraining


class Mirror(nn.Sequential):
    """Features through a few numbers a frame and back."""

    def __init__(self, config: MirrorConfig) -> None:
        super().__init__(nn.Linear(FEATURES, config.rank), nn.Linear(config.rank, FEATURES))


class Scale(nn.Module):
    """The largest feature that the exported network makes of what it knows."""

    def __init__(self, largest: float = 0.0) -> None:
        super().__init__()
        self.register_buffer("largest", torch.tensor(largest))


def learn(run: Run[MirrorRecipe], settings: ReconstructionTraining, job: Job) -> Loop:
    torch.manual_seed(job.seed)
    data, model = job.data, Mirror(run.recipe.model)
    std = data.statistics()[1]
    loop = job.loop(model, settings.loop)

    def step(iteration: int, generator: torch.Generator) -> tuple[Tensor, Figures]:
        features = data.draw_any(settings.frames, settings.loop.batch, generator)
        loss, error = reconstruction_loss(model(features), features, std, settings.reconstruction)
        return loss, {"error_m": error, FRAMES: float(features.shape[:2].numel())}

    loop.run(step)
    return loop


@torch.no_grad()
def measured(run: Run[MirrorRecipe], folder: Path) -> Scale:
    model = Mirror(run.recipe.model)
    load_weights(model, folder / "network.safetensors")
    return Scale(float(model(beginnings(run.clips(["train"], True), 40)).abs().max()))


def figures(run: Run[MirrorRecipe], parts: Mapping[str, nn.Module], train: ClipSet, test: ClipSet) -> dict[str, Any]:
    return {"reconstruction": {"40": error_by_source(parts["network"], test, 40)}}


def columns(run: Run[MirrorRecipe]) -> dict[str, Any]:
    return {"rank": run.recipe.model.rank}


PLAN = Training(
    recipe=MirrorRecipe,
    stages=(Stage("network", Mirror, learn, report=lambda loop: [f"Mirrors: {loop.iteration}.", ""]),),
    parts={"network": lambda run: run.finished("network").averaged},
    manifest=manifest_of("mirror"),
    measure=figures,
    report=lambda found: source_table(found["reconstruction"]),
    measured={"scale": measured},
    comparison=Comparison("network", columns),
)
HERE = "tests.scenectl.training.test_stages:PLAN"
train = partial(command.train, plan=PLAN)


def family(name: str, training: str | None) -> Family:
    def refuse(weights: object, settings: object) -> Any:
        raise AssertionError("training opens no generator")

    return Family(name, Spec(fps=20.0, shortest=1.0, longest=10.0, window=10.0), BaseModel, refuse, training=training)


@pytest.fixture(autouse=True)
def registered() -> Iterator[None]:
    made = (family("mirror", HERE), family("untrained", None), family("elsewhere", "tests.scenectl.small:walk"))
    for each in made:
        register(each)
    yield
    for each in made:
        forget(each.name)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return walks(tmp_path_factory.mktemp("data"))


@pytest.fixture
def recipe(tmp_path: Path) -> Path:
    path = tmp_path / "mirror.toml"
    path.write_text(RECIPE)
    return path


def weights_of(folder: Path) -> dict[str, Tensor]:
    from safetensors.torch import load_file

    return load_file(folder / "state.safetensors")


def test_a_family_is_trained_by_its_plan_alone(data: Path, recipe: Path, tmp_path: Path) -> None:
    plan = plan_of(recipe)
    assert plan.commands == ("network", "export", "scale")
    run = command.train("all", data, recipe, tmp_path / "run", plan=plan)
    folder = run / "weights"
    names = {"network.safetensors", "scale.safetensors", "manifest.json", "MODEL_CARD.md", "metrics.json", "curves.png"}
    assert {path.name for path in folder.iterdir()} == names
    found = described(folder)
    assert (found.family, found.config) == ("mirror", {"name": "tiny mirror", "rank": 4})
    assert {name: path.name for name, path in found.parts.items()} == {
        "network": "network.safetensors",
        "scale": "scale.safetensors",
    }
    assert found.licence.startswith("non-commercial") and len(found.credits) == 2
    model, scale = Mirror(MirrorConfig(name="", rank=4)), Scale()
    load_weights(model, found.part("network"))
    load_weights(scale, found.part("scale"))
    trained = weights_of(run / "network")
    torch.testing.assert_close(model[0].weight, trained["averaged.0.weight"], atol=1e-3, rtol=1e-3)
    assert float(scale.largest) > 0
    card = (folder / "MODEL_CARD.md").read_text()
    for words in ("# Model card: tiny mirror", "| network | 6 |", "Mirrors: 6.", "| 40 | 2 | all |", "CC BY-NC 4.0"):
        assert words in card
    assert json.loads((folder / "metrics.json").read_text())["reconstruction"]["40"]["all"]["clips"] == 2.0


def test_a_killed_run_ends_as_if_it_had_not_been(
    data: Path, recipe: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, own = train("network", data, recipe, tmp_path / "whole"), Loop._step

    def step(loop: Loop, function: Any) -> Any:
        if loop.iteration == 3:
            loop.save()
            raise InterruptedError
        return own(loop, function)

    monkeypatch.setattr(Loop, "_step", step)
    with pytest.raises(InterruptedError):
        train("network", data, recipe, tmp_path / "killed")
    monkeypatch.setattr(Loop, "_step", own)
    train("network", data, recipe, tmp_path / "killed")
    assert same(weights_of(tmp_path / "killed" / "network"), weights_of(whole / "network"))


def test_variants_are_compared(data: Path, recipe: Path, tmp_path: Path) -> None:
    rows = train_sweep(data, recipe, tmp_path / "sweep", 2, "cpu", plan=plan_of(recipe))
    assert [(row["variant"], row["rank"], row["iterations"]) for row in rows] == [("plain", 4, 2), ("narrow", 1, 2)]
    assert rows[0]["parameters_m"] > rows[1]["parameters_m"]


def test_what_a_plan_lacks_is_said(data: Path, recipe: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"unknown stage 'netwrok'.*did you mean 'network'"):
        train("netwrok", data, recipe, tmp_path / "run")
    with pytest.raises(UserError, match="reads no text"):
        train("network", data, recipe, tmp_path / "run", text="none")
    with pytest.raises(UserError, match="holds no trained network"):
        train("export", data, recipe, tmp_path / "run")
    with pytest.raises(UserError, match="do not exist"):
        train("scale", data, recipe, tmp_path / "run")
    with pytest.raises(UserError, match="has no sweep"):
        alone = Training(MirrorRecipe, PLAN.stages, PLAN.parts, PLAN.manifest)
        train_sweep(data, recipe, tmp_path / "sweep", 2, "cpu", plan=alone)


def test_recipes_name_their_family(recipe: Path) -> None:
    assert plan_of("compact").commands == ("tokenizer", "decoder", "refiner", "transformer", "export", "metric")
    for name, words in (
        ("mirrow", "did you mean 'mirror'"),
        ("untrained", "cannot be trained"),
        ("elsewhere", "is no"),
    ):
        recipe.write_text(RECIPE.replace('"mirror"', f'"{name}"'))
        with pytest.raises(UserError, match=words):
            plan_of(recipe)
    with pytest.raises(UserError, match="'family' is 'elsewhere': input should be 'mirror'"):
        load_recipe(recipe, MirrorRecipe)
    recipe.write_text(RECIPE.replace('family = "mirror"', ""))
    assert load_recipe(recipe, MirrorRecipe).family == "mirror"


def test_training_knows_no_family() -> None:
    code = (
        "import sys, scenectl.training.command, scenectl.training.sweep, scenectl.training.captions\n"
        "print([name for name in sys.modules if name.startswith('scenectl.generators')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
