"""A motion folder of a few walks in the format of the collection."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from tests.scenectl.small import walk

QUANTUM = 0.0005


def write_folder(folder: Path, clips: dict[str, tuple[Tensor, dict[str, object]]]) -> Path:
    """Write joints ``[T, 22, 3]`` and rows of `clips.jsonl` (merged over defaults) as the README describes."""
    folder.mkdir(parents=True, exist_ok=True)
    deltas, lengths, rows = [], [], []
    for key, (joints, about) in clips.items():
        relative = joints.numpy().astype(np.float64).copy()
        relative[:, 1:] -= relative[:, :1]
        units = np.round(relative / QUANTUM).astype(np.int64)
        deltas.append(np.concatenate([units[:1], np.diff(units, axis=0)]))
        lengths.append(len(joints))
        rows.append(
            {
                "id": key,
                "source": "cmu",
                "split": "train",
                "label": "walk",
                "licence": "free",
                "commercial_ok": True,
                "captions": [{"text": "A person walks.", "kind": "human"}],
                **about,
            }
        )
    np.savez_compressed(
        folder / "motions_20fps.npz",
        delta=np.concatenate(deltas).transpose(1, 2, 0).astype(np.int16),
        quant=np.float64(QUANTUM),
        length=np.array(lengths, dtype=np.int32),
        ids=np.array(list(clips)),
        fps=np.int64(20),
    )
    (folder / "clips.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    return folder


def walks(folder: Path) -> Path:
    """Seven walks of two sources: five to train on, two to test on."""
    clips: dict[str, tuple[Tensor, dict[str, object]]] = {}
    for i in range(7):
        about: dict[str, object] = {"split": "train" if i < 5 else "test"}
        if i % 2:
            label = "walk-turn-left | normal" if i % 4 == 1 else "walk | normal"
            about |= {"source": "bandai", "label": label, "licence": "CC BY-NC 4.0", "commercial_ok": False}
        joints = walk(50 + 6 * i, speed=0.9 + 0.1 * i, turn=0.4 * i)
        clips[f"clip{i}"] = joints, {**about, "captions": [{"text": f"A person walks, take {i}, left."}]}
    return write_folder(folder, clips)


def same(a: dict[str, Tensor], b: dict[str, Tensor]) -> bool:
    """Whether two states are bit for bit the same."""
    return a.keys() == b.keys() and all(torch.equal(a[name], b[name]) for name in a)
