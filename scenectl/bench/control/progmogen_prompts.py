"""The evaluation prompts and constraint values of ProgMoGen (Liu et al., CVPR 2024), from a JSON file.

The file holds ``hsi1``: rows of caption, length and three head heights, and ``n32``: the 32 (caption, length) pairs
that HSI-2, HSI-3 and GEO-1 share; ``hoi1`` is checked and kept where it is there. Lengths are frames at 20 fps.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from scenes.errors import UserError
from scenes.validation import sentence

FPS = 20.0
"""Frames a second of the benchmark's lengths."""

_Frames = Annotated[int, Field(ge=2, le=196)]
_Text = Annotated[str, Field(min_length=1)]
_Metre = Annotated[float, Field(allow_inf_nan=False)]
_Point = tuple[_Metre, _Metre, _Metre]


class Prompt(BaseModel):
    """A caption and a length in frames."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    caption: _Text
    length: _Frames

    @property
    def seconds(self) -> float:
        """Length in seconds."""
        return self.length / FPS


class HeadHeights(Prompt):
    """HSI-1: heights of the head (m) at the first frame, at frame length // 2, and at the last."""

    head_heights_m: _Point


class WristPath(Prompt):
    """HOI-1: where the left wrist starts and ends (m)."""

    left_wrist_start_m: _Point
    left_wrist_end_m: _Point


class ProgMoGenPrompts(BaseModel):
    """All rows of a prompt file, in its order (544, 32 and 32 in the published one)."""

    model_config = ConfigDict(frozen=True)

    hsi1: tuple[HeadHeights, ...] = Field(min_length=1)
    n32: tuple[Prompt, ...] = Field(min_length=1)
    hoi1: tuple[WristPath, ...] = ()


def load_progmogen(path: str | Path) -> ProgMoGenPrompts:
    """Read a prompt file.

    Raises:
        UserError: the file is missing, is not JSON, or a row lacks something (it is named).
    """
    path = Path(path)
    if path.is_dir():
        path = path / "progmogen.json"
    if not path.is_file():
        raise UserError(f"ProgMoGen prompt file '{path}' does not exist")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UserError(f"ProgMoGen prompt file '{path}' is not readable JSON ({error})") from error
    try:
        return ProgMoGenPrompts.model_validate(content)
    except ValidationError as error:
        raise UserError(f"ProgMoGen prompt file '{path}': {sentence(error, content, ProgMoGenPrompts)}") from error
