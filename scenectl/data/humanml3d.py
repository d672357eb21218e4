"""A HumanML3D folder, as its users build it from AMASS: 263 features a frame, captions, splits, statistics.

Layout (Guo et al. 2022): ``new_joint_vecs/<id>.npy``, ``texts/<id>.txt`` with lines ``caption#tokens#start#end``,
``train.txt``, ``val.txt``, ``test.txt`` with one id a line, ``Mean.npy`` and ``Std.npy``. Ids that begin with M are
mirrored copies. A caption with start and end seconds describes that part only, which is then a clip of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.data.features import FEATURES, FPS
from scenes.errors import UserError, did_you_mean
from scenes.files import read_array, reading

_LONGEST = 1e6
"""Seconds of a caption at most, whatever is written: more than eleven days."""

SPLITS = ("train", "val", "test")
LICENCE = "HumanML3D (MIT) on AMASS (non-commercial research)"


@dataclass(frozen=True)
class Caption:
    """A sentence about a clip, or about the part of it from `start` to `end` seconds.

    Attributes:
        text: the sentence.
        tokens: its words with their part of speech, ``walk/VERB``, as the data set gives them.
        start: seconds; 0 together with `end` 0 means all of the clip.
        end: seconds.
    """

    text: str
    tokens: tuple[str, ...]
    start: float = 0.0
    end: float = 0.0

    @property
    def whole(self) -> bool:
        """Whether it describes all of the clip."""
        return self.start == 0 and self.end == 0


@dataclass(frozen=True)
class FeatureClip:
    """A motion and the sentences that describe all of it.

    Attributes:
        id: the data set's id, with ``@start-end`` (seconds) for a part of a clip.
        features: at 20 fps, not normalised, ``[T, 263]``.
        captions: at least one.
        mirrored: whether it is a mirrored copy.
    """

    id: str
    features: Float[Tensor, "T 263"]
    captions: tuple[Caption, ...]
    mirrored: bool


class HumanML3D:
    """A folder of the data set.

    Attributes:
        folder: where it lies.
    """

    def __init__(self, folder: str | Path) -> None:
        """Check that the folder has the layout; reads nothing yet.

        Raises:
            UserError: the folder or one of its sub-folders is missing.
        """
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise UserError(f"HumanML3D folder '{folder}' does not exist")
        for part in ("new_joint_vecs", "texts"):
            if not (self.folder / part).is_dir():
                raise UserError(f"HumanML3D folder '{folder}' has no folder '{part}'; give the one that holds it")

    def ids(self, split: str) -> list[str]:
        """Ids listed for a split, mirrored ones included, whether or not their files exist."""
        if split not in SPLITS:
            raise UserError(f"HumanML3D has no split '{split}'{did_you_mean(split, SPLITS)}")
        path = self.folder / f"{split}.txt"
        if not path.is_file():
            raise UserError(f"HumanML3D folder '{self.folder}' has no {split}.txt, the list of ids of that split")
        with reading(f"list of ids '{path}'", "make it again with the data set's own notebooks"):
            return path.read_text(encoding="utf-8").split()

    def clips(
        self, split: str, min_frames: int = 40, max_frames: int = 199, mirrored: bool = True
    ) -> Iterator[FeatureClip]:
        """Clips of a split in the order of its list; ids without files are passed over.

        Copies without AMASS's HumanAct12 part lack some thousand.

        Captions of the same part share a clip, in the order of the file. The default lengths are those of the
        data set's own evaluation, 40 <= frames < 200 (protocol 3.4).

        Args:
            split: "train", "val" or "test".
            min_frames: shorter clips and parts are left out.
            max_frames: longer ones too.
            mirrored: whether to include mirrored copies.

        Raises:
            UserError: unknown split, no listed id has files, or a file that is not what it should be (named).
        """
        ids = [name for name in self.ids(split) if mirrored or not name.startswith("M")]
        present = [name for name in ids if all(path.is_file() for path in self._paths(name))]
        if not present:
            raise UserError(
                f"HumanML3D folder '{self.folder}' has no motion and text for any of the ids in {split}.txt"
            )
        for name in present:
            for clip in self._parts(name):
                if min_frames <= len(clip.features) <= max_frames:
                    yield clip

    def _paths(self, name: str) -> tuple[Path, Path]:
        return self.folder / "new_joint_vecs" / f"{name}.npy", self.folder / "texts" / f"{name}.txt"

    def _parts(self, name: str) -> Iterator[FeatureClip]:
        motion, text = self._paths(name)
        features = torch.from_numpy(_rows(motion))
        parts: dict[tuple[float, float], list[Caption]] = {}
        for caption in read_captions(text):
            parts.setdefault((caption.start, caption.end), []).append(caption)
        for (start, end), captions in parts.items():
            whole = captions[0].whole
            rows = features if whole else features[int(start * FPS) : int(end * FPS)]
            label = name if whole else f"{name}@{start:g}-{end:g}"
            yield FeatureClip(label, rows, tuple(captions), name.startswith("M"))


def read_captions(path: str | Path) -> list[Caption]:
    """The captions in one of the data set's text files.

    Raises:
        UserError: the file is missing, a line is not ``caption#tokens#start#end`` (it is named), or there is none.
    """
    path = Path(path)
    with reading(f"caption file '{path}'", "fetch the data set's own again"):
        lines = path.read_text(encoding="utf-8").splitlines()
    captions = [_caption(line, f"caption file '{path}', line {i}") for i, line in enumerate(lines, 1) if line.strip()]
    if not captions:
        raise UserError(f"caption file '{path}' holds no caption")
    return captions


def _caption(line: str, where: str) -> Caption:
    fields = line.strip().split("#")
    if len(fields) != 4 or not fields[0].strip():
        raise UserError(f"{where}: expected 'caption#tokens#start#end', found '{line.strip()[:60]}'")
    try:
        start, end = (float(field) for field in fields[2:])
    except ValueError as error:
        raise UserError(f"{where}: start and end must be seconds, found '{fields[2]}' and '{fields[3]}'") from error
    # the data set writes nan for "not stated"
    start, end = (0.0 if math.isnan(value) else value for value in (start, end))
    if not (0 <= start <= _LONGEST and 0 <= end <= _LONGEST):
        raise UserError(f"{where}: start and end must be seconds from 0, found {start:g} and {end:g}")
    return Caption(fields[0].strip(), tuple(fields[1].split()), start, end)


def _rows(path: Path) -> np.ndarray:
    """A float32 array ``[T, 263]``."""
    array = read_array(path, "HumanML3D file", "[T, 263]", "make it again, or leave its id out of the split list")
    if array.shape[-1] != FEATURES:
        hint = "; these look like KIT's" if array.shape[-1] == 251 else ""
        raise UserError(f"HumanML3D file '{path}' has {array.shape[-1]} features a frame instead of {FEATURES}{hint}")
    return array
