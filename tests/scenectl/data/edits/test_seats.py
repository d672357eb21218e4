"""Sittings led onto other seats: the seat's height, planted feet, knees that bend forward, and what is said."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest
import torch

from scenectl.data.corpus import Clip
from scenectl.data.edits.seats import HIPS, SEAT, seated
from scenectl.data.features import to_uniform_skeleton
from tests.scenectl.data.edits.stands import sitting

HIP, KNEE, ANKLE, BALL = [1, 2], [4, 5], [7, 8], [10, 11]
NAMES = {"sit down", "sit", "stand up", "composed"}


def many(clip: Clip, count: int = 24) -> list[tuple[str, Clip]]:
    made = [seated(clip, random.Random(seed)) for seed in range(count)]
    return [(copy.label.rpartition(", ")[2], copy) for copy in made if copy is not None]


def test_all_parts_of_a_sitting_are_made() -> None:
    made = many(sitting())
    assert {name for name, _ in made} == NAMES and len(made) == 24
    heights = [float(copy.joints[len(copy.joints) // 2, HIP, 1].mean()) for name, copy in made if name == "sit"]
    assert min(heights) > SEAT[0] + HIPS - 0.03 and max(heights) < SEAT[1] + HIPS + 0.03
    assert max(heights) - min(heights) > 0.05


def test_bones_feet_and_knees_are_as_they_should() -> None:
    for name, copy in many(sitting()):
        joints = copy.joints
        torch.testing.assert_close(to_uniform_skeleton(joints), joints, atol=2e-3, rtol=0)
        assert float(joints[:, BALL].diff(dim=0).norm(dim=-1).max()) < 3e-3
        assert float(joints[..., 1].min()) > -1e-5
        assert float(joints.diff(n=2, dim=0).norm(dim=-1).max()) * 400 < 15, name  # m/s^2
        ahead = joints[:, KNEE] - (joints[:, HIP] + joints[:, ANKLE]) / 2
        assert float(ahead[..., 2].min()) > 0


def test_each_part_begins_and_ends_where_it_says() -> None:
    for name, copy in many(sitting()):
        y = copy.joints[:, 0, 1]
        assert (y[0] > 0.8) == (name in ("sit down", "composed"))
        assert (y[-1] > 0.8) == (name in ("stand up", "composed"))
        if name == "sit":
            assert 60 <= copy.frames <= 160 and float(y.max() - y.min()) < 0.1


def test_a_whole_sitting_says_its_acts_in_order() -> None:
    whole = [copy for name, copy in many(sitting()) if name == "composed"]
    for copy in whole:
        down, sit, up = copy.acts
        assert (down.begin, sit.begin, up.begin, up.end) == (0, down.end, sit.end, copy.frames)
        assert any("sits down" in text or "seat" in text or "lowers" in text for text in down.captions)
        y = copy.joints[:, 0, 1]
        assert float(y[sit.begin : sit.end].max()) < float(y[0]) - 0.1
        assert copy.captions


def test_who_does_not_sit_is_left_alone() -> None:
    clip = sitting()
    assert seated(replace(clip, label="squat", captions=("a person squats.",)), random.Random(0)) is None
    high = replace(clip, joints=clip.joints + torch.tensor([0.0, 0.5, 0.0]))
    assert seated(high, random.Random(0)) is None
    assert seated(replace(clip, joints=clip.joints[:5]), random.Random(0)) is None


@pytest.mark.parametrize("begin, end, name", [(0, 80, "sit down"), (80, 160, "stand up"), (60, 100, "sit")])
def test_pieces_are_as_good_as_takes(begin: int, end: int, name: str) -> None:
    clip = sitting()
    made = many(replace(clip, joints=clip.joints[begin:end], label=f"sit on stool, {name}"), 12)
    assert made and {found for found, _ in made} <= {name, "sit"}
