"""Skeletons of other people: found exactly where their pieces are rigid, and ours where they are ours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from hypothesis import given, settings, strategies as st

from scenectl.bench.studies.rotations import animated
from scenes.motion.fitting import SAME, fitted, skeleton_of
from scenes.motion.kinematics import forward
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid
from scenes.motion.skeleton import HUMANML3D, Skeleton, with_lengths


def another(seed: int) -> Skeleton:
    """Of other lengths, and with hips, spine, neck and collars elsewhere."""
    draw = np.random.default_rng(seed)
    offsets = np.array(with_lengths(HUMANML3D, HUMANML3D.bone_lengths * draw.uniform(0.8, 1.2, 22)).offsets)
    pieces = HUMANML3D.indices(["left_hip", "right_hip", "spine1", "neck", "left_collar", "right_collar"])
    offsets[pieces] += draw.normal(size=(6, 3)) * 0.02
    return replace(HUMANML3D, offsets=tuple((x, y, z) for x, y, z in offsets.tolist()))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6))
def test_a_rigid_body_is_found_exactly(seed: int) -> None:
    theirs = another(seed)
    motion = rigid(animated(40, seed)[1], theirs)
    found = skeleton_of(replace(motion, skeleton=HUMANML3D))
    np.testing.assert_allclose(found.bone_lengths, theirs.bone_lengths, atol=1e-6)
    again = replace(motion, skeleton=found)
    assert (forward(again.rotations, motion.joints[:, 0], found) - motion.joints).abs().max() < 1e-6


def test_our_own_lengths_keep_our_skeleton() -> None:
    motion = animated(40, 0)[1]
    assert skeleton_of(motion) is HUMANML3D
    off = with_lengths(HUMANML3D, HUMANML3D.bone_lengths + 2 * SAME * (np.arange(22) == 4))
    assert skeleton_of(rigid(motion, off)) is off
    assert skeleton_of(replace(rigid(motion, off), skeleton=HUMANML3D)) != HUMANML3D


def test_padding_and_batches_and_nothing_at_all() -> None:
    motion = rigid(animated(40, 0)[1], another(1))
    torn = torch.cat([motion.joints, torch.randn(20, 22, 3, dtype=torch.float64)])
    padded = Motion(torn, torch.arange(60) < 40)
    assert fitted(padded) == fitted(replace(motion, skeleton=HUMANML3D))
    batch = fitted(Motion(torn[None], torch.arange(60)[None] < 40))
    np.testing.assert_allclose(batch.offsets, fitted(padded).offsets)
    assert fitted(Motion(torn, torch.zeros(60, dtype=torch.bool))) is HUMANML3D
