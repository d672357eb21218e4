"""A motion folder of a few walks in the format of the collection."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from scenectl.data.collection import write_collection
from scenes.motion.motion import Motion
from tests.scenectl.small import walk

CMU: dict[str, object] = {
    "source": "cmu", "label": "walk", "licence": "free", "commercial_ok": True,
    "captions": [{"text": "A person walks.", "kind": "human"}],
}  # fmt: skip


def write_folder(folder: Path, clips: dict[str, tuple[Tensor, dict[str, object]]]) -> Path:
    """Write joints ``[T, 22, 3]`` and rows of `clips.jsonl`, merged over CMU's."""
    return write_collection(folder, {key: (Motion(joints), {**CMU, **about}) for key, (joints, about) in clips.items()})


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
