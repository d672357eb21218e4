"""Motion clips with captions: the shared motion-capture collection, and what training draws from any source."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.data import held_out
from scenectl.data.features import FPS, canonicalise, mirror, to_uniform_skeleton
from scenes.errors import UserError
from scenes.files import reading

COLLECTION = ("motions_20fps.npz", "clips.jsonl")
"""What a folder of the collection holds."""

MAX_ROOT_ACCELERATION = 50.0
"""m/s^2; a pelvis that accelerates faster is a capture error (a sprinter's stays below 20)."""

CREDITS = {
    "cmu": "The data used in this project was obtained from mocap.cs.cmu.edu. "
    "The database was created with funding from NSF EIA-0196217.",
    "hdm05": "M. Müller, T. Röder, M. Clausen, B. Eberhardt, B. Krüger, A. Weber, "
    "Documentation Mocap Database HDM05, CG-2007-2, Universität Bonn.",
    "snu": "Yoonsang Lee, SNU Movement Research Lab.",
    "mesh2motion": "Quaternius, Mesh2Motion.",
    "deepmimic": "X. B. Peng, DeepMimic.",
    "sie": "Sony Interactive Entertainment.",
    "bandai": "Bandai Namco Research Inc.",
}
"""What the sources ask to be said wherever something made from them is shipped."""

HOW = (
    "give --data a motion collection, which scenectl.data.collection.write_collection makes of your own BVH, npy or "
    "npz files (docs/formats.md)"
)
"""Where to get one."""

UNTRUE = {("cmu", "127_01"): "a person stands still."}
"""Captions that their clips do not show: who sits on a motorcycle that is not there holds both fists up."""

TOGETHER = " + "
"""Between the sources, and between the licences, of a clip that is made of several."""

_SWAP = {"left": "right", "right": "left", "clockwise": "counterclockwise", "counterclockwise": "clockwise"}
_SIDES = re.compile(rf"(?<![^ ])({'|'.join(_SWAP)})(?=[.,;:!]*(?: |\Z))")
"""Those words, with punctuation behind them or without."""


@dataclass(frozen=True)
class Act:
    """One of the things that a clip shows one after another.

    Attributes:
        begin, end: frames, up to and without `end`.
        captions: sentences that say it, each with a subject ("a person sits down.").
    """

    begin: int
    end: int
    captions: tuple[str, ...]


@dataclass(frozen=True)
class Clip:
    """One captioned clip.

    Attributes:
        id: name within its source; augmented copies carry a suffix.
        joints: metres at 20 fps on the uniform skeleton, ``[T, 22, 3]``, canonical frame.
        captions: sentences that describe all of it.
        source: data set it comes from.
        split: "train", "val" or "test", or "held out" (`scenectl.data.held_out`).
        label: kind of motion, as the source names it.
        licence: terms of the clip.
        commercial_ok: whether weights trained on it may be used commercially.
        acts: what it shows one after another, in order and without gaps; none where it is one thing all through.
    """

    id: str
    joints: Float[Tensor, "T 22 3"]
    captions: tuple[str, ...]
    source: str
    split: str
    label: str
    licence: str
    commercial_ok: bool
    acts: tuple[Act, ...] = ()

    @property
    def frames(self) -> int:
        return int(self.joints.shape[0])


def load_motions(folder: str | Path, splits: Sequence[str] = ("train",)) -> list[Clip]:
    """Clips of a `motions_20fps.npz` + `clips.jsonl` folder, on the uniform skeleton, capture errors left out.

    Raises:
        UserError: a file is missing or not of this format.
    """
    folder = Path(folder)
    for name in COLLECTION:
        if not (folder / name).is_file():
            raise UserError(f"motion folder '{folder}' has no {name}; recorded motions are needed: {HOW}")
    with reading(f"motion folder '{folder}'", "it is not in the expected format, see the README of the collection"):
        positions = _positions(folder / "motions_20fps.npz")
        text = (folder / "clips.jsonl").read_text(encoding="utf-8")
        rows = [json.loads(line) for line in text.splitlines() if line.strip()]
        clips = [_clip(row, positions[row["id"]]) for row in rows if _split(row) in splits]
    return [clip for clip in clips if clip.frames >= 2 and not _has_spike(clip.joints)]


def _positions(path: Path) -> dict[str, np.ndarray]:
    """Joint positions by clip id; stored as time differences of half-millimetre integers."""
    with np.load(path, allow_pickle=False) as data:
        delta = data["delta"].transpose(2, 0, 1)
        ends = np.cumsum(np.r_[0, data["length"]])
        quantum, ids = float(data["quant"]), [str(i) for i in data["ids"]]
    out = {}
    for i, key in enumerate(ids):
        joints = np.cumsum(delta[ends[i] : ends[i + 1]].astype(np.int32), axis=0) * quantum
        joints[:, 1:] += joints[:, :1]
        if not np.isfinite(joints).all():
            raise ValueError(f"clip {key} holds numbers that are not finite")
        out[key] = joints.astype(np.float32)
    return out


def _split(row: dict[str, object]) -> str:
    return held_out.SPLIT if (row["source"], row["id"]) in held_out.TAKES else str(row["split"])


def _clip(row: dict[str, object], joints: np.ndarray) -> Clip:
    if not isinstance(row["commercial_ok"], bool):  # "false" is true to Python
        raise ValueError(f"commercial_ok of clip {row['id']} is {row['commercial_ok']!r}, neither true nor false")
    seconds = joints.shape[0] / FPS
    untrue = UNTRUE.get((str(row["source"]), str(row["id"])))
    captions = [c for c in row["captions"] if _describes_all(c, seconds) and str(c["text"]).lower() != untrue]  # type: ignore[attr-defined]
    return Clip(
        id=str(row["id"]),
        joints=canonicalise(to_uniform_skeleton(torch.from_numpy(joints))),
        captions=tuple(str(c["text"]).lower().strip() for c in captions),
        source=str(row["source"]),
        split=_split(row),
        label=str(row["label"]).split(" | ")[0],
        licence=str(row["licence"]),
        commercial_ok=bool(row["commercial_ok"]),
    )


def _describes_all(caption: dict[str, object], seconds: float) -> bool:
    """Captions of a part of a clip would teach the wrong thing."""
    start, end = float(caption.get("start", 0.0)), float(caption.get("end", seconds))  # type: ignore[arg-type]
    return end - start > 0.8 * seconds


def _has_spike(joints: Float[Tensor, "T 22 3"]) -> bool:
    acceleration = joints[:, 0].diff(n=2, dim=0).norm(dim=-1) * FPS**2
    return bool((acceleration > MAX_ROOT_ACCELERATION).any())


def mirrored(clip: Clip) -> Clip:
    """The clip by a person whose sides are exchanged, captions included."""
    label = "-".join(_SWAP.get(part, part) for part in clip.label.split("-"))
    return replace(
        clip,
        id=f"{clip.id}~m",
        joints=canonicalise(mirror(clip.joints)),
        captions=_swapped(clip.captions),
        label=label,
        acts=tuple(replace(act, captions=_swapped(act.captions)) for act in clip.acts),
    )


def combined(clips: Sequence[Clip]) -> dict[str, Any]:
    """Source, licence and commercial_ok of something made of all these clips: every source with its own terms."""
    pairs = sorted({pair for clip in clips for pair in terms_of(clip.source, clip.licence)})
    return {
        "source": TOGETHER.join(source for source, _ in pairs),
        "licence": TOGETHER.join(licence for _, licence in pairs),
        "commercial_ok": all(clip.commercial_ok for clip in clips),
    }


def terms_of(source: str, licence: str) -> list[tuple[str, str]]:
    """Each source of a clip and its licence; clips made of several name them in the same order."""
    return list(zip(source.split(TOGETHER), licence.split(TOGETHER), strict=True))


def _swapped(captions: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(_SIDES.sub(lambda word: _SWAP[word[0]], text) for text in captions)


def bent(clip: Clip, curvature: float) -> Clip:
    """The clip with its path bent into an arc of the given curvature (rad/m, positive to the person's left).

    The bend is a fixed map of the floor plane, so a planted foot stays planted; bone lengths, which it
    stretches by a few per cent, are restored afterwards.
    """
    x, y, z = clip.joints.unbind(-1)
    radius = 1.0 / curvature
    angle = curvature * z
    warped = torch.stack([radius - (radius - x) * angle.cos(), y, (radius - x) * angle.sin()], dim=-1)
    joints = canonicalise(to_uniform_skeleton(warped))
    return replace(clip, id=f"{clip.id}~b{curvature:+.2f}", joints=joints)


def retimed(clip: Clip, speed: float) -> Clip:
    """The clip played `speed` times as fast, linearly resampled to 20 fps."""
    frames = max(2, round((clip.frames - 1) / speed) + 1)
    at = torch.linspace(0, clip.frames - 1, frames, device=clip.joints.device)
    low = at.floor().long().clamp_max(clip.frames - 2)
    part = (at - low)[:, None, None]
    joints = clip.joints[low] * (1 - part) + clip.joints[low + 1] * part
    edges = [round(act.begin * frames / clip.frames) for act in clip.acts] + [frames]
    acts = tuple(
        replace(act, begin=begin, end=end) for act, begin, end in zip(clip.acts, edges[:-1], edges[1:], strict=True)
    )
    return replace(clip, id=f"{clip.id}~s{speed:.2f}", joints=joints, acts=acts)
