"""Making a motion collection, which training and benches read, of motions from anywhere."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from scenectl.data.features import FPS
from scenes.errors import UserError
from scenes.files import atomic_write
from scenes.motion.motion import Motion

QUANTUM = 0.0005
"""Metres in a unit of the stored whole numbers."""
ABOUT: dict[str, Any] = {"source": "own", "split": "train", "label": "", "licence": "unstated", "commercial_ok": False}
"""What is said about a clip where its row says nothing."""


def write_collection(folder: str | Path, clips: Mapping[str, tuple[Motion, Mapping[str, Any]]]) -> Path:
    """Write `motions_20fps.npz` and `clips.jsonl`, as docs/formats.md describes them.

    Args:
        folder: made where there is none.
        clips: by id: a motion ``[T, 22, 3]`` at any rate (`scenectl.data.formats.motions.load_motion`), and what is
            said about it: `captions`, a sentence or several, and any of `ABOUT`'s keys.

    Raises:
        UserError: no clip, one without a caption, or one that moves faster or farther than 16 m.
    """
    folder = Path(folder)
    if not clips:
        raise UserError(f"motion collection '{folder}' would hold no clip; give one or more")
    deltas, rows = [], []
    for name, (motion, about) in clips.items():
        deltas.append(_delta(name, motion))
        told = about.get("captions", ())
        told = (told,) if isinstance(told, str) else told
        sentences = [words if isinstance(words, dict) else {"text": words} for words in told]
        if not sentences:
            raise UserError(f"clip '{name}' has no caption; say what happens, such as 'a person walks'")
        rows.append({"id": name, **ABOUT, **about, "captions": sentences})
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_write(folder / "motions_20fps.npz") as file:
        np.savez_compressed(
            file,
            delta=np.concatenate(deltas).transpose(1, 2, 0).astype(np.int16),
            quant=np.float64(QUANTUM),
            length=np.array([len(delta) for delta in deltas], dtype=np.int32),
            ids=np.array([*clips]),
            fps=np.int64(FPS),
        )
    with atomic_write(folder / "clips.jsonl", "w") as file:
        file.writelines(json.dumps(row) + "\n" for row in rows)
    return folder


def _delta(name: str, motion: Motion) -> np.ndarray:
    """Steps from frame to frame in units of `QUANTUM`, ``[T, 22, 3]``: of the pelvis, and of joints as seen from it."""
    real = motion.joints[motion.valid] if motion.joints.ndim == 3 else motion.joints[:0]
    if not len(real):
        raise UserError(f"clip '{name}' is no single motion with frames; choose one with motion[i]")
    joints = Motion(real, fps=motion.fps).resampled(FPS).joints.double().numpy().copy()
    joints[..., [0, 2]] -= joints[:1, :1, [0, 2]].copy()
    joints[:, 1:] -= joints[:, :1].copy()
    units = np.round(joints / QUANTUM).astype(np.int64)
    delta: np.ndarray = np.concatenate([units[:1], np.diff(units, axis=0)])
    if np.abs(delta).max() > np.iinfo(np.int16).max:
        raise UserError(f"clip '{name}' jumps, or stands {np.abs(joints).max():.0f} m high; is it in metres?")
    return delta
