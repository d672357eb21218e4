"""Repeats: bodies, feet and speed stay what they were; the path goes on where and whither it led."""

from __future__ import annotations

import random

import pytest
import torch

from scenectl.data.augment import Augmentation, augmented
from scenectl.data.corpus import Clip, bent
from scenectl.data.features import canonicalise, smoothed_heading, to_uniform_skeleton
from scenectl.data.repeat import repeated
from tests.scenectl.small import walk


def walking(frames: int = 60, **changes: object) -> Clip:
    joints = canonicalise(walk(frames))
    return Clip(**{"id": "a", "joints": joints, "captions": ("a person walks.",), "source": "cmu", "split": "train",
                   "label": "walk", "licence": "free", "commercial_ok": True} | changes)  # fmt: skip


def longer(clip: Clip, frames: int = 160) -> Clip:
    copy = repeated(clip, random.Random(0), (frames, frames))
    assert copy is not None
    return copy


def test_a_walk_goes_on_at_its_own_pace_on_planted_feet() -> None:
    clip, copy = walking(), longer(walking())
    assert abs(copy.frames - 160) < 40 and copy.captions == clip.captions
    torch.testing.assert_close(to_uniform_skeleton(copy.joints), copy.joints, atol=2e-3, rtol=0)
    pace = [float(c.joints[:, 0].diff(dim=0)[:, [0, 2]].norm(dim=-1).mean()) for c in (clip, copy)]
    assert pace[1] == pytest.approx(pace[0], rel=0.05)
    for c in (clip, copy):
        steps = c.joints[:, [10, 11]].diff(dim=0).norm(dim=-1)
        assert float(steps.amin(-1).max()) < 0.01  # one foot stands at any time
    jumps = [float(c.joints.diff(n=2, dim=0).norm(dim=-1).max()) for c in (clip, copy)]
    assert jumps[1] < 1.2 * jumps[0]


def test_a_curve_goes_on_turning() -> None:
    clip = bent(walking(80), 0.4)
    steps = [smoothed_heading(c.joints).diff() for c in (clip, longer(clip, 150))]
    rate = [float(torch.atan2(step.sin(), step.cos()).mean()) for step in steps]
    assert rate[0] > 0.01
    assert rate[1] == pytest.approx(rate[0], rel=0.2)


def test_what_never_comes_back_is_not_repeated() -> None:
    joints = walk(60).clone()
    joints[:, 20:22, 1] += torch.linspace(0, 1, 60)[:, None] * 3
    assert repeated(walking(joints=joints), random.Random(0)) is None
    assert repeated(walking(12), random.Random(0)) is None
    assert repeated(walking(60), random.Random(0), (50, 50)) is None  # long enough already


def test_only_repeating_kinds_get_copies() -> None:
    plain = Augmentation.none(repeat=1.0)
    assert [c.id for c in augmented([walking()], plain, 0)] == ["a", "a~repeat"]
    assert len(augmented([walking(label="bow")], plain, 0)) == 1
    assert len(augmented([walking()], plain.model_copy(update={"repeat": 0.0}), 0)) == 1
