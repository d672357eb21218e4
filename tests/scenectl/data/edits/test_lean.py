"""Leaning: eased in and out over planted feet, hands that stay where they are put."""

from __future__ import annotations

import random

import torch

from scenectl.data.corpus import Clip
from scenectl.data.edits.lean import leaning
from scenectl.data.features import to_uniform_skeleton
from tests.scenectl.data.edits.stands import standing
from tests.scenectl.small import walk

NECK, WRISTS, BALL = 12, {"left": 20, "right": 21}, [10, 11]


def many(count: int = 24) -> list[Clip]:
    clip = Clip("a", standing(), ("a person stands.",), "cmu", "train", "idle", "free", True)
    made = [leaning(clip, random.Random(seed)) for seed in range(count)]
    assert all(copy is not None for copy in made)
    return [copy for copy in made if copy is not None]


def test_bodies_lean_and_come_back_over_planted_feet() -> None:
    for copy in many():
        joints = copy.joints
        torch.testing.assert_close(to_uniform_skeleton(joints), joints, atol=2e-3, rtol=0)
        assert float(joints[:, BALL].diff(dim=0).norm(dim=-1).max()) < 3e-3
        assert float(joints[..., 1].min()) > -1e-5
        off = (joints[:, NECK] - joints[:1, NECK]).norm(dim=-1)
        assert float(off.max()) > 0.08 and float(off[-1]) < 0.05
        assert float(joints.diff(n=2, dim=0).norm(dim=-1).max()) * 400 < 40  # m/s^2
        assert copy.label == "idle, lean" and 60 <= copy.frames <= 160


def test_a_hand_that_leans_stays_where_it_is() -> None:
    ways = set()
    for copy in many():
        text = " ".join(copy.captions)
        side = next((side for side in WRISTS if side in text), None)
        if side is None:
            continue
        ways.add(side)
        wrist = copy.joints[:, WRISTS[side]]
        far = (wrist - wrist[:1]).norm(dim=-1)
        held = wrist[far > 0.97 * float(far.max())]
        assert float(far.max()) > 0.2 and len(held) > 15
        assert float((held - held.mean(0)).norm(dim=-1).max()) < 0.03
    assert ways == {"left", "right"}


def test_who_does_not_stand_still_does_not_lean() -> None:
    clip = Clip("a", walk(100), ("a person walks.",), "cmu", "train", "walk", "free", True)
    assert leaning(clip, random.Random(0)) is None
