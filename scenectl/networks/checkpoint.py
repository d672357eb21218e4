"""Weights on disk: safetensors, with everything needed to rebuild the network in the header. Never pickle."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import torch
from pydantic import ValidationError
from safetensors import safe_open
from safetensors.torch import save
from torch import nn
from torch.overrides import TorchFunctionMode

from scenes.errors import UserError
from scenes.files import atomic_write
from scenes.validation import sentence

M = TypeVar("M", bound=nn.Module)

_KIND = "scenectl"


def save_weights(module: nn.Module, path: str | Path, about: dict[str, Any], *, half: bool = False) -> None:
    """Write a module's weights and a description; whole or not at all.

    Args:
        module: its `state_dict` is stored.
        path: file to write.
        about: JSON-able description, read back by `read_about`.
        half: store floating-point tensors in half precision, which halves the file.
    """
    state = {
        name: (tensor.half() if half and tensor.is_floating_point() else tensor).detach().contiguous().cpu()
        for name, tensor in module.state_dict().items()
    }
    with atomic_write(path) as file:
        file.write(save(state, metadata={_KIND: json.dumps(about)}))


def read_about(path: str | Path) -> dict[str, Any]:
    """The description that was stored with weights; raises UserError where there is none."""
    path = Path(path)
    if not path.is_file():
        raise UserError(f"weights '{path}' do not exist; train them or name another folder")
    try:
        with safe_open(path, framework="pt") as file:
            about: dict[str, Any] = dict(json.loads((file.metadata() or {})[_KIND]))
            return about
    except Exception as error:  # of many kinds; all mean the same to a user
        raise UserError(
            f"weights '{path}' are not a scenectl checkpoint or are damaged ({_first_line(error)})"
        ) from error


def load_network(path: Path, build: Callable[[Any], M], what: str) -> M:
    """A frozen network, built from the configuration that stands with its weights.

    Args:
        path: file of the weights.
        build: the network for a configuration; raises what it will for another network's.
        what: the network, in words.

    Raises:
        UserError: weights are missing, damaged, or of another network.
    """
    about = read_about(path)
    network = untrained(path, lambda: build(about["config"]), what)
    load_weights(network, path)
    return network.eval().requires_grad_(False)


def untrained(path: Path, build: Callable[[], M], what: str) -> M:
    """A network as it is built, which may take no more memory than a file of its size accounts for.

    Args:
        path: file of the weights, whose shapes `load_weights` compares.
        build: the network of the configuration that stands with them.
        what: the network, in words.

    Raises:
        UserError: the configuration describes no such network, or a larger one.
    """
    with _opened(path) as file:
        stored = sum(math.prod(file.get_slice(name).get_shape()) for name in file.keys())  # noqa: SIM118 - not a dict
    try:
        with _Budget(2 * stored + 1_000_000):
            return build()
    except UserError:
        raise
    except _Larger as error:
        raise UserError(f"weights '{path}' belong to a network of another shape; check its config") from error
    except Exception as error:  # what networks raise for sizes that cannot be is anything
        reason = sentence(error, None, None) if isinstance(error, ValidationError) else _first_line(error)
        raise UserError(
            f"weights '{path}' describe no {what} ({reason}); train it again or name another folder"
        ) from error


class _Larger(Exception):
    """A network asks for more than its budget."""


class _Budget(TorchFunctionMode):
    """Within the block, tensors made of sizes may hold so many numbers in all."""

    def __init__(self, left: int) -> None:
        super().__init__()
        self.left = left

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        if func in _MADE_OF_SIZES:
            sizes = args[0] if args and isinstance(args[0], Sequence) else args
            self.left -= math.prod(sizes) if func is not torch.eye else sizes[0] ** 2
            if self.left < 0:
                raise _Larger
        return func(*args, **(kwargs or {}))


_MADE_OF_SIZES = (torch.empty, torch.zeros, torch.ones, torch.randn, torch.rand, torch.eye)


def load_weights(module: nn.Module, path: str | Path) -> None:
    """Fill a module with stored weights, in the module's own precision; raises UserError where they do not fit."""
    path = Path(path)
    read_about(path)
    wanted = module.state_dict()
    with _opened(path) as file:
        state = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a dict
    if state.keys() != wanted.keys() or any(state[n].shape != wanted[n].shape for n in wanted):
        raise UserError(f"weights '{path}' belong to a network of another shape; check its config")
    state = {name: tensor.to(wanted[name].dtype) for name, tensor in state.items()}
    if not all(bool(torch.isfinite(t).all()) for t in state.values()):
        raise UserError(f"weights '{path}' hold numbers that are not finite; train again or fetch them again")
    module.load_state_dict(state)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """A safetensors file; raises UserError for a damaged one."""
    try:
        with safe_open(path, framework="pt") as file:
            yield file
    except UserError:
        raise
    except Exception as error:
        raise UserError(f"weights '{path}' are damaged ({_first_line(error)})") from error


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
