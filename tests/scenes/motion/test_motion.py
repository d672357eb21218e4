"""Motions on disk: what is written is read back, and anything else is answered in a sentence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, strategies as st

from scenes.errors import UserError
from scenes.motion.frames import FAR, HOME, Place, back, origin_near
from scenes.motion.kinematics import forward
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.rigid import rigid
from scenes.motion.skeleton import HUMANML3D

MOTION = Motion(torch.rand(2, 5, 22, 3, generator=torch.Generator().manual_seed(0)), fps=25.0, t0=0.5)


def test_a_motion_is_read_back_as_it_was_written(tmp_path: Path) -> None:
    MOTION.save(tmp_path / "motion.npz", note="kept beside it")
    again = Motion.load(tmp_path / "motion.npz")
    assert torch.equal(again.joints, MOTION.joints) and torch.equal(again.valid, MOTION.valid)
    assert (again.fps, again.t0, again.skeleton) == (25.0, 0.5, MOTION.skeleton)


def test_far_from_the_origin_doubles_are_kept_and_near_it_single_precision_is(tmp_path: Path) -> None:
    far = MOTION.moved((500_000.0, 0.0, 4_500_000.0))
    assert far.joints.dtype == torch.float64 and MOTION.moved(HOME) is MOTION
    gap = replace(far, joints=far.joints.clone(), valid=far.valid.clone())
    gap.joints[0, -1], gap.valid[0, -1] = torch.nan, False
    for motion, kind in ((far, torch.float64), (MOTION, torch.float32), (MOTION.moved((9.0, 0.0, 0.0)), torch.float32)):
        motion.save(tmp_path / "motion.npz")
        again = Motion.load(tmp_path / "motion.npz")
        assert again.joints.dtype == kind and torch.equal(again.joints, motion.joints.to(kind))
    gap.save(tmp_path / "motion.npz")  # padding may hold anything
    with np.load(tmp_path / "motion.npz") as data:
        assert data["joints"].dtype == np.float64


@given(place=st.tuples(*[st.floats(-1e7, 1e7)] * 3), step=st.sampled_from((20.0, 100.0)))
def test_a_frame_begins_near_what_is_far_and_comes_and_goes_without_a_trace(place: Place, step: float) -> None:
    origin = origin_near(place, step)
    for at, begin in zip(place, origin, strict=True):
        assert begin % step == 0 and abs(at - begin) <= (step / 2 if abs(at) >= FAR else abs(at))
    there = MOTION.moved(origin)
    assert torch.allclose(there.seen_from(origin).joints, MOTION.joints, atol=2e-9, rtol=0)
    pose = Pose2D(place, 0.3)
    np.testing.assert_allclose(pose.moved(back(origin)).moved(origin).position, place, atol=2e-9, rtol=0)


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


def test_the_file_holds_rotations_that_carry_its_joints(tmp_path: Path) -> None:
    motion = rigid(MOTION)
    motion.save(tmp_path / "motion.npz")
    with np.load(tmp_path / "motion.npz") as data:
        assert int(data["format"]) == 2 and data["rotations"].shape == (2, 5, 22, 4)
        skeleton = replace(HUMANML3D, offsets=tuple(map(tuple, data["offsets"].tolist())))
        turned, root = torch.from_numpy(data["rotations"]), torch.from_numpy(data["joints"])[..., 0, :]
        back = forward(turned, root, skeleton) - torch.from_numpy(data["joints"])
    assert back.abs().max() < 1e-4


HANGING = np.array([(0, 0, 0) if p < 0 else (0, -length, 0) for p, length in zip(
    HUMANML3D.parents, HUMANML3D.bone_lengths, strict=True)])  # fmt: skip
"""Offsets as files had them before format 2: other directions, the same lengths."""


@pytest.mark.parametrize("fps", [7.0, 30.0, 60.0])
def test_rigid_bodies_are_rigid_at_any_rate(fps: float) -> None:
    joints = rigid(Motion(MOTION.joints.double())).joints
    there = Motion(joints, fps=20.0).resampled(fps)
    again = forward(there.rotations, there.joints[..., 0, :], there.skeleton)
    assert float((again - there.joints).abs().max()) < 1e-5


def test_other_bodies_go_from_frame_to_frame_at_any_rate() -> None:
    between = MOTION.resampled(50.0)
    torch.testing.assert_close(between.joints[:, ::2], MOTION.joints, rtol=0, atol=1e-5)
    again = Motion(MOTION.joints.flip(1), fps=25.0).resampled(50.0 + 1e-9)
    torch.testing.assert_close(again.joints.flip(1), between.joints, rtol=0, atol=1e-5)


def test_older_files_rest_in_the_t_pose(tmp_path: Path) -> None:
    tree = {"joint_names": np.array(HUMANML3D.names), "parents": np.array(HUMANML3D.parents)}
    for offsets, wanted in ((HANGING, HUMANML3D.offsets), (1.2 * HANGING, 1.2 * np.array(HUMANML3D.offsets))):
        np.savez(tmp_path / "old.npz", joints=MOTION.joints, fps=20.0, offsets=offsets, **tree)
        np.testing.assert_allclose(Motion.load(tmp_path / "old.npz").skeleton.offsets, wanted, atol=1e-9)
    np.savez(tmp_path / "new.npz", joints=MOTION.joints, fps=20.0, offsets=HANGING, format=2, **tree)
    np.testing.assert_array_equal(Motion.load(tmp_path / "new.npz").skeleton.offsets, HANGING)


@pytest.mark.parametrize(
    ("rotations", "message"),
    [
        (np.zeros((2, 5, 22, 3)), r"'rotations' have shape \(2, 5, 22, 3\)"),
        (np.full((2, 5, 22, 4), np.nan), "not finite"),
        (np.full((2, 5, 22, 4), 0.6), "off unit length by 0.2"),
        (np.full((2, 5, 22, 4), "0.5"), "not numbers"),
    ],
)
def test_unsound_rotations_are_refused_in_a_sentence(rotations: np.ndarray, message: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "motion.npz", joints=MOTION.joints, fps=20.0, format=2, rotations=rotations)
    with pytest.raises(UserError, match=message):
        Motion.load(tmp_path / "motion.npz")
    for kind in ({}, {"format": "theirs"}, {"format": 1}):  # what others call rotations is nothing to us
        np.savez(tmp_path / "other.npz", joints=MOTION.joints, fps=20.0, rotations=rotations, **kind)
        if not (kind == {"format": 1} and rotations.dtype.kind == "U"):
            assert torch.equal(Motion.load(tmp_path / "other.npz").joints, MOTION.joints)


def test_other_files_and_none_are_refused_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "words.npz").write_text("no arrays")
    with pytest.raises(UserError, match="was not written by scenectl"):
        Motion.load(tmp_path / "words.npz")
    with pytest.raises(UserError, match="does not exist"):
        Motion.load(tmp_path / "none.npz")
