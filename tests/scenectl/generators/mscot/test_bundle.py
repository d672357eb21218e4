"""A bundle of MSCoT's networks: loaded frozen, and refused in a sentence where parts do not belong together."""

from __future__ import annotations

import resource
import shutil
from pathlib import Path

import pytest
from torch import nn

from scenectl.generators.mscot.bundle import PARTS, build, load_bundle
from scenectl.generators.mscot.config import ModelConfig
from scenectl.generators.weights import described, weights_folder
from scenectl.networks.checkpoint import save_weights
from scenes.errors import UserError
from tests.scenectl.small import config


def sentence(error: pytest.ExceptionInfo[UserError], path: Path) -> str:
    text = str(error.value)
    assert "\n" not in text and str(path) in text and len(text) < 400
    return text


def write_bundle(folder: Path, settings: ModelConfig) -> None:
    about = {"config": settings.model_dump(mode="json"), "licence": "CC0-1.0"}
    for part, made in zip(PARTS, build(settings), strict=True):
        save_weights(made, folder / f"{part}.safetensors", about)


def plain(**changes: object) -> ModelConfig:
    """Small networks for the text encoder 'none', whose features have one number."""
    return config(text_dim=1, **changes)


def test_a_bundle_is_loaded_frozen_with_its_licence(tmp_path: Path) -> None:
    write_bundle(tmp_path, plain())
    made = load_bundle(described(tmp_path))
    assert made.config == plain() and made.licence == "CC0-1.0" and made.text.name == "none"
    for network in (made.tokenizer, made.transformer, made.refiner):
        assert not network.training and not any(p.requires_grad for p in network.parameters())


def test_parts_of_different_models_are_refused(tmp_path: Path) -> None:
    write_bundle(tmp_path, plain())
    write_bundle(tmp_path / "other", plain(prefix="cumulative"))
    shutil.copy(tmp_path / "other" / "transformer.safetensors", tmp_path)
    with pytest.raises(UserError, match="different models") as error:
        load_bundle(described(tmp_path))
    sentence(error, tmp_path)


@pytest.mark.parametrize(
    "about",
    [
        {},
        {"config": 3, "licence": ""},
        {"config": {"name": "x"}, "licence": ""},
        {"config": plain().model_dump(mode="json")},
        {"config": {**plain().model_dump(mode="json"), "surprise": 1}, "licence": ""},
    ],
)
def test_a_description_that_describes_no_model_is_refused(tmp_path: Path, about: dict[str, object]) -> None:
    for part in PARTS:
        save_weights(nn.Linear(3, 4), tmp_path / f"{part}.safetensors", about)
    with pytest.raises(UserError, match="describe no model") as error:
        load_bundle(described(tmp_path))
    sentence(error, tmp_path)


def test_a_text_encoder_of_another_width_is_refused(tmp_path: Path) -> None:
    write_bundle(tmp_path, config())
    with pytest.raises(UserError, match="text encoder 'none'") as error:
        load_bundle(described(tmp_path))
    sentence(error, tmp_path)


def test_unknown_names_and_empty_folders_are_answered(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no weights 'nowhere'"):
        weights_folder("nowhere")
    with pytest.raises(UserError, match="holds no weights"):
        load_bundle(described(tmp_path))
    write_bundle(tmp_path, plain())
    (tmp_path / "refiner.safetensors").unlink()
    with pytest.raises(UserError, match="refiner") as error:
        load_bundle(described(tmp_path))
    sentence(error, tmp_path)


SIZES = {
    "tokenizer": {
        "codes": [2**31, 0, 2**16], "width": [2**14, "wide"], "depth": [10**9], "dilation_growth": [2**70],
        "scales": [[0, 2, 3, 5], [-2, 2, 3, 5], [], [5, 3, 2, 1], [1] * 10**6], "scale_convs": [0], "code_dim": [-1],
    },
    "transformer": {
        "heads": [2**63, 0, 3], "width": [1, 2, 10**12], "layers": [10**9, 200], "text_dim": [2**40],
        "dropout": [float("nan"), -1.0],
    },
    "refiner": {"heads": [5], "width": [3], "kind": ["magic"]},
}  # fmt: skip
CASES = [(table, key, value) for table, keys in SIZES.items() for key, values in keys.items() for value in values]


@pytest.mark.parametrize(("table", "key", "value"), CASES)
def test_sizes_that_cannot_be_are_refused_before_there_is_memory_for_them(
    table: str, key: str, value: object, tmp_path: Path
) -> None:
    write_bundle(tmp_path, plain())
    described_as = plain().model_dump(mode="json")
    described_as[table][key] = value
    for part, made in zip(PARTS, build(plain()), strict=True):
        save_weights(made, tmp_path / f"{part}.safetensors", {"config": described_as, "licence": "CC0-1.0"})
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(UserError) as error:
        load_bundle(described(tmp_path))
    sentence(error, tmp_path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000


@pytest.mark.parametrize("change", [{"credits": 5}, {"licence": None}, {"family": ["mscot"]}, {"config": []}])
def test_headers_of_other_types_are_refused(change: dict[str, object], tmp_path: Path) -> None:
    about = {"config": plain().model_dump(mode="json"), "licence": "CC0-1.0", **change}
    for part, made in zip(PARTS, build(plain()), strict=True):
        save_weights(made, tmp_path / f"{part}.safetensors", about)
    with pytest.raises(UserError, match="describe no model") as error:
        load_bundle(described(tmp_path))
    sentence(error, tmp_path)
