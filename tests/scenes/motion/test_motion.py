"""Motions on disk: what is written is read back, and anything else is answered in a sentence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from scenes.errors import UserError
from scenes.motion.motion import Motion

MOTION = Motion(torch.rand(2, 5, 22, 3, generator=torch.Generator().manual_seed(0)), fps=25.0, t0=0.5)


def test_a_motion_is_read_back_as_it_was_written(tmp_path: Path) -> None:
    MOTION.save(tmp_path / "motion.npz", note="kept beside it")
    again = Motion.load(tmp_path / "motion.npz")
    assert torch.equal(again.joints, MOTION.joints) and torch.equal(again.valid, MOTION.valid)
    assert (again.fps, again.t0, again.skeleton) == (25.0, 0.5, MOTION.skeleton)


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        (replace(MOTION, joints=MOTION.joints * torch.nan), "not finite"),
        (replace(MOTION, joints=MOTION.joints[:, :0], valid=MOTION.valid[:, :0]), "holds no frames"),
        (replace(MOTION, fps=0.0), "has 0 frames a second"),
    ],
)
def test_unsound_motions_are_refused_in_a_sentence(motion: Motion, message: str, tmp_path: Path) -> None:
    motion.save(tmp_path / "motion.npz")
    with pytest.raises(UserError, match=rf"motion file '.*motion.npz'.*{message}.*save the motion again"):
        Motion.load(tmp_path / "motion.npz")


def test_other_files_and_none_are_refused_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "words.npz").write_text("no arrays")
    with pytest.raises(UserError, match="was not written by scenectl"):
        Motion.load(tmp_path / "words.npz")
    with pytest.raises(UserError, match="does not exist"):
        Motion.load(tmp_path / "none.npz")
