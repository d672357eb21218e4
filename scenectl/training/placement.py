"""Where a training runs, and in what precision: decided once, asked by every stage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch

from scenectl.networks.precision import cpu_has_bfloat16
from scenectl.networks.text import TimedText
from scenes.errors import UserError, did_you_mean

Precision = Literal["auto", "float32", "bfloat16"]
DEVICES = ("auto", "cpu", "cuda")

_CPU = torch.device("cpu")


@dataclass(frozen=True)
class Placement:
    """A device, and the type in which networks compute there; weights, losses and joints stay in float32.

    Attributes:
        device: holds networks, their optimiser and the batch at hand.
        compute: float32, or bfloat16 under autocast.
    """

    device: torch.device = _CPU
    compute: torch.dtype = torch.float32

    def autocast(self) -> torch.autocast:
        """Context in which networks compute; does nothing in float32."""
        return torch.autocast(self.device.type, dtype=torch.bfloat16, enabled=self.compute is torch.bfloat16)

    def text(self, prompt: TimedText) -> TimedText:
        """The prompt on the device."""
        return prompt.each(lambda part: part.to(self.device))


def place(device: str = "auto", precision: Precision = "auto") -> Placement:
    """Choose a device and a precision.

    Args:
        device: "cpu", "cuda", or "auto": an accelerator where there is one.
        precision: "float32", "bfloat16", or "auto": bfloat16 on an accelerator that has it and on a CPU with
            instructions for it (avx512_bf16, amx), where it pays; float32 elsewhere.

    Raises:
        UserError: unknown device, or one that this machine lacks.
    """
    if device not in DEVICES:
        raise UserError(f"unknown device '{device}'{did_you_mean(device, DEVICES)}")
    if device == "cuda" and not torch.cuda.is_available():
        raise UserError("device 'cuda' is not there (torch finds no accelerator); take --device cpu or auto")
    name = device if device != "auto" else "cuda" if torch.cuda.is_available() else "cpu"
    if precision == "auto":
        fast = torch.cuda.is_bf16_supported(including_emulation=False) if name == "cuda" else cpu_has_bfloat16()
        precision = "bfloat16" if fast else "float32"
    return Placement(torch.device(name), torch.bfloat16 if precision == "bfloat16" else torch.float32)
