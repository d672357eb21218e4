"""Writing in pictures: plain text, cut to fit, and labels that neither overlap nor leave the picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from scenectl.view.stage import INK

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageFont import FreeTypeFont

Box = tuple[float, float, float, float]
"""Left, top, right and bottom, pixels from the upper left."""
Colour = tuple[int, int, int]

MET, MISSED = (27, 106, 62), (176, 32, 32)
"""Of writing about goals: at least 5 to 1 in contrast on the paper behind it, so that small letters are read."""
PAPER = (255, 255, 255)
COARSE = 4
"""Pixels of a picture along a pixel of what is known to be busy."""
LONG = 28
"""Letters of a name in a label."""
_HEIGHT, _LEAST = 0.021, 8
"""Height of letters as a share of the picture's height, and the least in pixels."""
_BACKED = 214
"""Opacity of the paper behind labels, of 255."""
_WAYS = [(math.sin(a), -math.cos(a)) for a in map(math.radians, (0, 35, -35, 70, -70, 90, -90, 125, -125, 180))]
"""Where a label is tried around its anchor: above first."""
_AWAY = (0.3, 0.9, 1.8, 3.0, 4.5, 7.0, 10.0)
"""Distances from the anchor at which it is tried, in heights of letters."""
_COVER = 1.5
"""Heights of letters by which a label goes further away to uncover a square of that height of a person."""


class Label(NamedTuple):
    """Lines of text that say what is at an anchor (pixels from the upper left)."""

    text: str
    anchor: tuple[float, float]
    colour: Colour = INK


class Panel(NamedTuple):
    """A part of a picture.

    Attributes:
        image: ``[h, w, 3]`` sRGB.
        labels: at pixels of the image, those that matter most first.
        busy: what labels should rather not cover, a value for `COARSE` pixels of the image.
    """

    image: np.ndarray
    labels: Sequence[Label]
    busy: np.ndarray


@lru_cache
def font(height: int) -> FreeTypeFont:
    """The font of all writing, which comes with matplotlib; its letters are `height` pixels high with their room."""
    from matplotlib import get_data_path
    from PIL import ImageFont

    return ImageFont.truetype(str(Path(get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), height)


def letters(size: tuple[int, int]) -> int:
    """Height (pixels) of letters in a picture of a size (pixels)."""
    return max(_LEAST, round(_HEIGHT * min(size[1], size[0] / 1.6)))


def plain(text: str) -> str:
    """Text in one line, whatever controls and breaks it holds; nothing in it is markup."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def short(name: str, most: int = LONG) -> str:
    """A name in one line of at most so many letters."""
    name = plain(name)
    return name if len(name) <= most else name[: most - 1].rstrip() + "…"


def cut(text: str, width: float, type_: FreeTypeFont) -> str:
    """A line of at most `width` pixels: cut with an ellipsis where it is longer."""
    if type_.getlength(text) <= width:
        return text
    low, high = 0, len(text)
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if type_.getlength(text[:middle] + "…") <= width else (low, middle - 1)
    return text[:low].rstrip() + "…"


def spots(pixels: np.ndarray, radii: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Where discs at ``[n, 2]`` pixels with radii ``[n]`` cover a picture of a size: ``[h, w]``, coarse."""
    from PIL import Image, ImageDraw

    image = Image.new("1", (size[0] // COARSE, size[1] // COARSE))
    draw = ImageDraw.Draw(image)
    for (x, y), r in zip(pixels / COARSE, np.maximum(radii / COARSE, 0.5), strict=True):
        if np.isfinite(x + y + r):
            draw.ellipse((x - r, y - r, x + r, y + r), fill=1)
    return np.array(image)


def draw_labels(image: Image, labels: Sequence[Label], busy: np.ndarray, height: int) -> list[Box]:
    """Write labels near their anchors into an image; returns the boxes of those that found room.

    Args:
        image: RGB, drawn on in place.
        labels: those that matter most first.
        busy: what should rather not be covered, ``[h, w]`` from 0 to 1, a value for `COARSE` pixels of the image.
        height: of letters, pixels.
    """
    from PIL import ImageDraw

    draw, type_ = ImageDraw.Draw(image, "RGBA"), font(height)
    pad, total = height / 4, np.pad(busy.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    boxes: list[Box] = []
    for label in labels:
        left, top, right, bottom = draw.multiline_textbbox((0, 0), label.text, font=type_)
        size = (right - left + 2 * pad, bottom - top + 2 * pad)
        box = _place(label.anchor, size, height, boxes, total, image.size)
        if box is None:
            continue
        boxes.append(box)
        end = float(np.clip(label.anchor[0], box[0], box[2])), float(np.clip(label.anchor[1], box[1], box[3]))
        if np.hypot(end[0] - label.anchor[0], end[1] - label.anchor[1]) > height:
            draw.line([label.anchor, end], fill=(*label.colour, 150), width=max(1, height // 12))
        draw.rounded_rectangle(box, radius=pad, fill=(*PAPER, _BACKED))
        where = (box[0] + pad - left, box[1] + pad - top)
        draw.multiline_text(where, label.text, fill=(*label.colour, 255), font=type_, align="center")
    return boxes


def _place(
    anchor: tuple[float, float],
    size: tuple[float, float],
    height: int,
    boxes: Sequence[Box],
    total: np.ndarray,
    image: tuple[int, int],
) -> Box | None:
    """The place for a label of a size (pixels) that is near its anchor and covers little; None where there is none."""
    best: tuple[float, Box] | None = None
    gap = 0.15 * height
    for away in _AWAY:
        if best is not None and away >= best[0]:
            break
        for right, down in _WAYS:
            x = anchor[0] + right * (away * height + size[0] / 2)
            y = anchor[1] + down * (away * height + size[1] / 2)
            x = min(max(x, size[0] / 2), image[0] - size[0] / 2)
            y = min(max(y, size[1] / 2), image[1] - size[1] / 2)
            box = (x - size[0] / 2, y - size[1] / 2, x + size[0] / 2, y + size[1] / 2)
            if min(box) < 0 or any(_meet(box, other, gap) for other in boxes):
                continue
            cost = away + 0.2 * abs(right) + _COVER * _covered(total, box) / height**2
            if best is None or cost < best[0]:
                best = (cost, box)
    return None if best is None else best[1]


def _meet(a: Box, b: Box, gap: float) -> bool:
    return a[0] < b[2] + gap and b[0] < a[2] + gap and a[1] < b[3] + gap and b[1] < a[3] + gap


def _covered(total: np.ndarray, box: Box) -> float:
    """How much of a box is busy, pixels, by the running sums of what is busy."""
    height, width = total.shape[0] - 1, total.shape[1] - 1
    x0, x1 = (int(np.clip(v / COARSE, 0, width)) for v in (box[0], box[2]))
    y0, y1 = (int(np.clip(v / COARSE, 0, height)) for v in (box[1], box[3]))
    return COARSE**2 * float(total[y1, x1] - total[y0, x1] - total[y1, x0] + total[y0, x0])
