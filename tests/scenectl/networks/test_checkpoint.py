"""Weights on disk: what goes in comes out, and damage is answered in a sentence."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import save_file
from torch import nn

from scenectl.networks.checkpoint import load_network, load_weights, read_about, save_weights
from scenes.errors import UserError

ABOUT = {"config": {"a": [1, 2]}, "licence": "CC0-1.0", "ä": "ü"}


def network(width: int = 3) -> nn.Module:
    torch.manual_seed(width)
    made = nn.Linear(width, 4)
    made.register_buffer("count", torch.arange(5))
    return made


def sentence(error: pytest.ExceptionInfo[UserError], path: Path) -> str:
    text = str(error.value)
    assert "\n" not in text and str(path) in text and len(text) < 400
    return text


def test_weights_and_description_come_back(tmp_path: Path) -> None:
    made, other = network(), network()
    nn.init.zeros_(other.weight)
    save_weights(made, tmp_path / "deep" / "a.safetensors", ABOUT)
    load_weights(other, tmp_path / "deep" / "a.safetensors")
    assert all(torch.equal(a, b) for a, b in zip(made.state_dict().values(), other.state_dict().values(), strict=True))
    assert read_about(tmp_path / "deep" / "a.safetensors") == ABOUT
    assert [p.name for p in (tmp_path / "deep").iterdir()] == ["a.safetensors"]


def test_half_precision_is_smaller_and_loads_into_full(tmp_path: Path) -> None:
    made, other = nn.Linear(200, 50), nn.Linear(200, 50)
    save_weights(made, tmp_path / "full", ABOUT)
    save_weights(made, tmp_path / "half", ABOUT, half=True)
    assert (tmp_path / "half").stat().st_size < 0.6 * (tmp_path / "full").stat().st_size
    load_weights(other, tmp_path / "half")
    assert other.weight.dtype == torch.float32
    torch.testing.assert_close(other.weight, made.weight, atol=1e-4, rtol=1e-3)
    whole = network()
    save_weights(whole, tmp_path / "integers", ABOUT, half=True)
    load_weights(whole, tmp_path / "integers")
    assert whole.count.tolist() == [0, 1, 2, 3, 4] and whole.count.dtype == torch.int64


def test_damaged_and_foreign_files_are_refused_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    with pytest.raises(UserError, match="do not exist") as error:
        load_weights(network(), path)
    sentence(error, path)
    save_weights(network(), path, ABOUT)
    whole = path.read_bytes()
    save_file({"weight": torch.zeros(4, 3)}, tmp_path / "foreign")
    save_file({"weight": torch.zeros(4, 3)}, tmp_path / "not json", metadata={"scenectl": "{"})
    save_file({"weight": torch.zeros(4, 3)}, tmp_path / "no table", metadata={"scenectl": "[1]"})
    wrong = {
        "truncated": whole[: len(whole) // 2],
        "cut by one": whole[:-1],
        "header": b"\xff" * 8 + whole[8:],
        "empty": b"",
        "noise": bytes(range(256)) * 4,
        "pickle": pickle.dumps({"weight": 1}),
        **{name: (tmp_path / name).read_bytes() for name in ("foreign", "not json", "no table")},
    }
    for name, content in wrong.items():
        path.write_bytes(content)
        with pytest.raises(UserError, match="damaged") as error:
            load_weights(network(), path)
        sentence(error, path)
        assert name


def test_a_torch_checkpoint_is_never_unpickled(tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return exec, ("raise SystemExit('unpickled')",)

    path = tmp_path / "w.safetensors"
    torch.save({"weight": torch.zeros(3), "bomb": Bomb()}, path)
    with pytest.raises(UserError):
        load_weights(network(), path)


def test_weights_of_another_network_or_that_are_no_numbers_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    save_weights(network(3), path, ABOUT)
    with pytest.raises(UserError, match="another shape") as error:
        load_weights(network(5), path)
    sentence(error, path)
    with pytest.raises(UserError, match="another shape"):
        load_weights(nn.Linear(3, 4), path)
    for value in (float("nan"), float("inf")):
        broken = network(3)
        nn.init.constant_(broken.weight, 0.0)
        with torch.no_grad():
            broken.weight[0, 0] = value
        save_weights(broken, path, ABOUT)
        with pytest.raises(UserError, match="not finite") as error:
            load_weights(network(3), path)
        sentence(error, path)


def test_numbers_that_grow_too_large_in_the_networks_precision_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    save_weights(nn.Linear(3, 4).double().requires_grad_(False).apply(lambda m: m.weight.fill_(1e300)), path, ABOUT)
    with pytest.raises(UserError, match="not finite"):
        load_weights(nn.Linear(3, 4), path)


def test_a_header_nested_beyond_reason_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    save_file(
        {"weight": torch.zeros(4, 3)}, path, metadata={"scenectl": '{"config":' + "[" * 100_000 + "]" * 100_000 + "}"}
    )
    with pytest.raises(UserError, match="damaged") as error:
        read_about(path)
    sentence(error, path)


@pytest.mark.parametrize("width", [2**60, -1, 2.5, None, 7])
def test_a_network_is_laid_out_before_it_takes_memory(width: Any, tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    save_weights(nn.Linear(3, 4), path, {"config": {"width": width}})
    with pytest.raises(UserError, match=r"describe no line|another shape") as error:
        load_network(path, lambda config: nn.Linear(config["width"], 4), "line")
    sentence(error, path)
