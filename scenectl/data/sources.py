"""Folders that training reads: the motion collection, and HumanML3D as its users build it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from scenectl.data.augment import Augmentation
from scenectl.data.clips import ClipSet, Told, prepare
from scenectl.data.corpus import COLLECTION, HOW
from scenectl.data.humanml3d import LICENCE, SPLITS, FeatureClip, HumanML3D
from scenes.errors import UserError

HUMANML3D = ("new_joint_vecs", "texts", *(f"{split}.txt" for split in SPLITS), "Mean.npy", "Std.npy")
"""What such a folder holds."""


def is_humanml3d(folder: Path) -> bool:
    """Whether a folder is of HumanML3D's kind; looks at names only.

    Raises:
        UserError: it is of neither kind, or of HumanML3D's and incomplete: everything missing is named.
    """
    if not folder.is_dir():
        raise UserError(f"data folder '{folder}' does not exist, and recorded motions are needed: {HOW}, or HumanML3D")
    missing = [name for name in HUMANML3D if not (folder / name).exists()]
    if any((folder / name).exists() for name in COLLECTION):
        return False  # what it lacks, its own reader says
    if len(missing) == len(HUMANML3D):
        raise UserError(
            f"data folder '{folder}' has no {' or '.join(COLLECTION)} (a motion collection) and none of "
            f"{', '.join(HUMANML3D)} (HumanML3D): {HOW}, or HumanML3D"
        )
    if missing:
        raise UserError(
            f"HumanML3D folder '{folder}' lacks {', '.join(missing)}; make them with the data set's own notebooks, or "
            "give the folder that holds them all"
        )
    return True


def load_clips(
    folder: Path,
    splits: Sequence[str],
    augmentation: Augmentation | None,
    cache: Path,
    seed: int,
    commercial_only: bool = False,
) -> ClipSet:
    """Clips of a folder of either kind, as `scenectl.data.clips.prepare` gives them.

    HumanML3D is taken as it comes: its own features, clips and described parts of 40 to 199 frames, and of the
    augmentations only mirroring, for which it lists its own mirrored copies. Nothing is kept in `cache`.

    Raises:
        UserError: the folder is wrong or incomplete, a file is damaged, or nothing in it may be used.
    """
    if not is_humanml3d(folder):
        return prepare(folder, splits, augmentation, cache, seed, commercial_only)
    if commercial_only:
        raise UserError(f"HumanML3D folder '{folder}' may not be used commercially ({LICENCE}); name other data")
    data = HumanML3D(folder)
    mirrored = augmentation is None or augmentation.mirror
    clips = [clip for split in splits for clip in data.clips(split, mirrored=mirrored)]
    if not clips:
        raise UserError(f"HumanML3D folder '{folder}' has no clip of 40 to 199 frames in {' or '.join(splits)}.txt")
    return _joined(clips)


def _joined(clips: Sequence[FeatureClip]) -> ClipSet:
    count = len(clips)
    return ClipSet.of(
        [clip.features for clip in clips],
        told=[
            [Told(0, len(clip.features), [caption.text.lower().strip() for caption in clip.captions])] for clip in clips
        ],
        groups=["humanml3d"] * count,
        sources=["humanml3d"] * count,
        # A mirrored copy counts as augmented wherever the collection's do (clips: "~" in its name).
        ids=[f"{clip.id}~m" if clip.mirrored else clip.id for clip in clips],
        licences=[LICENCE] * count,
        commercial=[False] * count,
    )
