"""Coordinates of refinement: inverse maps, what they even out, files, and the measurement itself."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
import torch
from torch import Tensor

from scenectl.data.clips import ClipSet, Told
from scenectl.data.features import joints_to_features
from scenectl.generators.mscot.bundle import METRIC, PARTS, load_bundle
from scenectl.generators.mscot.networks.preconditioner import Preconditioner
from scenectl.generators.mscot.sampling import MSCoT
from scenectl.generators.mscot.training.preconditioner import measure_preconditioner
from scenectl.generators.weights import described
from scenectl.networks.checkpoint import save_weights
from scenes.errors import UserError
from scenes.motion.motion import Pose2D
from tests.scenectl.generators.mscot.test_mscot import Towards
from tests.scenectl.small import SCALES, bundle, walk


def energies(scales: int = 3, dim: int = 5) -> Tensor:
    draw = torch.randn(scales, 20, dim, generator=torch.Generator().manual_seed(3))
    draw = draw * torch.linspace(0.1, 3.0, dim) * torch.tensor([10.0, 1.0, 0.1])[:, None, None]
    return draw.mT @ draw


def adopted(energy: Tensor) -> Preconditioner:
    metric = Preconditioner(energy.shape[-1], len(energy))
    metric.adopt(energy)
    return metric


def test_unmeasured_it_changes_nothing() -> None:
    given = [torch.randn(2, n, 5) for n in (1, 2, 3)]
    for got, e in zip(Preconditioner(5, 3).embeddings(given), given, strict=True):
        assert torch.equal(got, e)


def test_coordinates_and_embeddings_are_inverse_and_linear() -> None:
    metric = adopted(energies()).double()
    given = [torch.randn(2, n, 5, dtype=torch.float64) for n in (1, 2, 3)]
    for got, e in zip(metric.embeddings(metric.coordinates(given)), given, strict=True):
        torch.testing.assert_close(got, e)
    double = metric.embeddings([2 * e for e in given])
    for twice, once in zip(double, metric.embeddings(given), strict=True):
        torch.testing.assert_close(twice, 2 * once)


def test_steps_of_one_length_move_a_body_about_as_much() -> None:
    """root^T G root has eigenvalues g / (g / mean + 1): what moves most is held down to the mean, at most."""
    energy = energies()
    mean = float(torch.einsum("kii->", energy)) / 15
    before = torch.linalg.eigvalsh(energy)
    after = torch.linalg.eigvalsh(adopted(energy).root.mT @ energy @ adopted(energy).root)
    torch.testing.assert_close(after, before / (before / mean + 1), rtol=1e-3, atol=1e-3)
    assert after.max() <= mean < 0.2 * before.max()


def walks() -> ClipSet:
    rows = torch.cat([joints_to_features(walk(201, speed, turn)) for speed, turn in ((1.0, 0.0), (1.4, 1.0))])
    two: list[str] = ["a", "b"]
    starts = torch.tensor([0, 200, 400])
    return ClipSet(
        rows, starts, [[Told(0, 200, ["a"])], [Told(0, 200, ["b"])]], two, ["cmu"] * 2, two, ["free"] * 2, [True] * 2
    )


def test_its_measurement_is_a_mean_whatever_was_drawn() -> None:
    made = bundle()
    got, other = (measure_preconditioner(made.tokenizer, made.refiner, walks(), seed) for seed in (0, 1))
    assert torch.equal(got.root, measure_preconditioner(made.tokenizer, made.refiner, walks(), 0).root)
    for metric in (got, other):
        assert metric.root.shape == (len(SCALES), 16, 16) and bool(metric.root.isfinite().all())
        torch.testing.assert_close(metric.root, metric.root.mT, rtol=1e-4, atol=1e-5)
    assert float((got.root - other.root).norm() / got.root.norm()) < 0.1
    # The coarsest token moves the whole motion, the finest a few frames: its steps are held down the more.
    assert float(got.root[0].norm()) < float(got.root[-1].norm())


@pytest.mark.parametrize("frames", [40, 100])
def test_it_is_measured_on_short_clips_where_there_are_no_others(frames: int) -> None:
    rows = joints_to_features(walk(frames + 1))
    data = ClipSet(rows, torch.tensor([0, frames]), [[Told(0, frames, ["a"])]], ["a"], ["cmu"], ["a"], ["free"], [True])
    made = bundle()
    assert bool(measure_preconditioner(made.tokenizer, made.refiner, data).root.isfinite().all())


def test_refinement_searches_in_its_coordinates() -> None:
    made = bundle()
    metric = adopted(energies_of_model())
    plain, shaped = MSCoT(made), MSCoT(dataclasses.replace(made, metric=metric))

    def motion(generator: MSCoT, shift: float) -> Tensor:
        step = generator.generate("a person walks", 2.0, Pose2D(), guide=Towards(), seed=3).step
        assert step is not None
        return step.at(step.value + shift).motion.joints

    torch.testing.assert_close(motion(shaped, 0.0), motion(plain, 0.0), atol=1e-4, rtol=0)  # the same motion there
    assert (motion(shaped, 0.5) - motion(plain, 0.5)).abs().max() > 1e-3


def energies_of_model() -> Tensor:
    draw = torch.randn(len(SCALES), 40, 16, generator=torch.Generator().manual_seed(3))
    return draw.mT @ draw


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    made = bundle()
    monkeypatch.setattr("scenectl.generators.mscot.bundle.load_text_encoder", lambda name: made.text)
    about = {"config": made.config.model_dump(mode="json"), "licence": "CC0-1.0"}
    for part in PARTS:
        save_weights(getattr(made, part), tmp_path / f"{part}.safetensors", about)
    return tmp_path


@pytest.mark.parametrize("manifest", [False, True])
def test_it_is_loaded_with_its_weights_and_not_missed_where_it_is_absent(folder: Path, manifest: bool) -> None:
    assert load_bundle(described(folder)).metric is None
    metric = adopted(energies_of_model())
    config = bundle().config.model_dump(mode="json")
    del config["transformer"]["prefix"]  # a field younger than the file: its default counts
    save_weights(metric, folder / f"{METRIC}.safetensors", {"config": config, "part": METRIC})
    if manifest:
        described(folder).save()
        assert (folder / "manifest.json").is_file()
    loaded = load_bundle(described(folder)).metric
    assert loaded is not None
    torch.testing.assert_close(loaded.root, metric.root)


def test_another_models_metric_is_refused(folder: Path) -> None:
    path = folder / f"{METRIC}.safetensors"
    other = bundle().config.model_dump(mode="json")
    other["tokenizer"]["codes"] *= 2
    save_weights(Preconditioner(16, len(SCALES)), path, {"config": other})
    with pytest.raises(UserError, match=r"belongs to another model; measure it anew"):
        load_bundle(described(folder))
    path.write_bytes(b"nonsense")
    with pytest.raises(UserError, match="damaged"):
        load_bundle(described(folder))
