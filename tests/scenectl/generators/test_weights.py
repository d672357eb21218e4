"""Folders of weights: what a manifest may say, and what is said of those that are none."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from scenectl.console.options import GENERATOR
from scenectl.generators import registry
from scenectl.generators.weights import (
    BUNDLED,
    FORMAT,
    Weights,
    bundled_weights,
    described,
    open_weights,
    weights_folder,
)
from scenes.errors import UserError

GOOD: dict[str, Any] = {
    "format": FORMAT,
    "family": "mscot",
    "parts": {"tokenizer": "t.safetensors"},
    "config": {"a": 1},
    "licence": "CC0-1.0",
    "credits": ["me"],
}


def test_a_manifest_comes_back_as_it_was_written(tmp_path: Path) -> None:
    weights = Weights(tmp_path, "mscot", {"tokenizer": tmp_path / "t.safetensors"}, {"a": 1}, "CC0-1.0", ("me",))
    weights.save()
    assert described(tmp_path) == weights and json.loads((tmp_path / "manifest.json").read_text()) == GOOD


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": FORMAT + 1}, "update scenectl"),
        ({"credits": "me"}, "credits"),
        ({"parts": ["t"]}, "parts"),
        ({"family": None}, "family"),
    ],
)
def test_a_manifest_that_cannot_be_is_refused_in_a_sentence(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    (tmp_path / "manifest.json").write_text(json.dumps(GOOD | change))
    with pytest.raises(UserError, match=words) as error:
        described(tmp_path)
    assert "\n" not in str(error.value) and "Error(" not in str(error.value)


@pytest.mark.parametrize("content", ["", "[1]", "{", "\x00"])
def test_nonsense_is_refused_in_a_sentence(tmp_path: Path, content: str) -> None:
    (tmp_path / "manifest.json").write_text(content)
    with pytest.raises(UserError, match=r"manifest\.json"):
        described(tmp_path)
    (tmp_path / "manifest.json").unlink()
    (tmp_path / "manifest.json").mkdir()
    with pytest.raises(UserError, match=r"manifest\.json.*cannot be read"):
        described(tmp_path)


def test_parts_never_lie_outside_the_folder(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text(json.dumps(GOOD | {"parts": {"tokenizer": "../../etc/passwd"}}))
    assert described(tmp_path).part("tokenizer") == tmp_path / "passwd"


def test_a_folder_does_not_hide_bundled_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "default").mkdir()
    assert weights_folder("default") == BUNDLED / "default" and "default" in bundled_weights()
    assert weights_folder("./default/").resolve() == tmp_path / "default"


def test_another_familys_weights_are_named(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text(json.dumps(GOOD | {"family": "other"}))
    with pytest.raises(UserError, match="those of generator 'other'"):
        open_weights(registry.find("mscot"), tmp_path)


def test_help_names_the_default_that_the_registry_has() -> None:
    assert GENERATOR == registry.DEFAULT
