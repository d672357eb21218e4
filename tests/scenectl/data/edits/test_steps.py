"""Stairs made of walks: every foot on its tread, none through an edge, legs within their reach."""

from __future__ import annotations

import random
import re

import pytest
import torch

from scenectl.data.corpus import Clip
from scenectl.data.edits.footfalls import footfalls, walk_of
from scenectl.data.edits.limbs import LEGS
from scenectl.data.edits.steps import HEEL, RISE, TOES, Stairs, climbed, climbing
from scenectl.data.features import canonicalise, to_uniform_skeleton
from scenes.motion.skeleton import HUMANML3D
from tests.scenectl.small import walk


def recorded(frames: int = 160) -> Clip:
    return Clip("a", canonicalise(walk(frames)), ("a person walks.",), "cmu", "train", "walk", "free", True)


def made(seed: int) -> tuple[Clip, Stairs]:
    found = climbed(recorded(), random.Random(seed))
    assert found is not None
    return found


def test_footfalls_of_a_walk_come_in_turn_and_overlap() -> None:
    falls = footfalls(recorded().joints)
    assert len(falls) > 6
    assert all(a.side != b.side and a.begin < b.begin < a.end for a, b in zip(falls, falls[1:], strict=False))


@pytest.mark.parametrize("slower", [1.0, 1.5])
def test_a_slower_walk_keeps_its_footfalls(slower: float) -> None:
    found = walk_of(recorded(), slower, 9)
    assert found is not None
    walked, falls = found
    assert len(falls) == 9
    for fall in falls:
        stand = walked.joints[fall.begin + 1 : fall.end - 1, LEGS[fall.side][3]]
        assert not len(stand) or float((stand - stand[0]).abs().max()) < 0.08


@pytest.mark.parametrize("seed", range(8))
def test_standing_feet_are_wholly_on_one_tread_and_at_its_height(seed: int) -> None:
    copy, stairs = made(seed)
    stood = set()
    for leg in LEGS:
        ankle, ball = (copy.joints[:, j] for j in leg[2:])
        still = torch.cat([ball.diff(dim=0).norm(dim=-1) < 2e-3, torch.tensor([False])])
        still &= (ankle - ball)[:, 1] < 0.075  # a heel that is up hangs over the edge, as it may
        heel, toes = stairs.height(ankle[still, 2] - HEEL), stairs.height(ball[still, 2] + TOES)
        torch.testing.assert_close(heel, toes)
        assert float((ball[still, 1] - toes).abs().max()) < 0.05
        stood |= set(toes.tolist())
    # The last landing may be reached with the last frame.
    assert len(set(stairs.levels.tolist()) - stood) <= 1


@pytest.mark.parametrize("seed", range(8))
def test_nothing_goes_through_a_step_and_legs_bend(seed: int) -> None:
    copy, stairs = made(seed)
    torch.testing.assert_close(to_uniform_skeleton(copy.joints), copy.joints, atol=2e-3, rtol=0)
    balls = copy.joints[:, [leg[3] for leg in LEGS]]
    assert float((balls[..., 1] - stairs.height(balls[..., 2])).min()) > -0.02
    thigh, shin = (float(HUMANML3D.bone_lengths[j]) for j in LEGS[0][1:3])
    for hip, _, ankle, _ in LEGS:
        assert float((copy.joints[:, hip] - copy.joints[:, ankle]).norm(dim=-1).max()) < 0.995 * (thigh + shin)


@pytest.mark.parametrize("seed", range(8))
def test_the_body_goes_as_high_as_the_stairs_and_the_way_that_is_said(seed: int) -> None:
    copy, stairs = made(seed)
    rise = float(copy.joints[-1, 0, 1] - copy.joints[0, 0, 1])
    whole = float(stairs.levels[-1] - stairs.levels[0])
    assert abs(rise - whole) < 0.75 * float(stairs.levels.diff().abs().max())
    assert all(RISE[0] - 1e-3 <= float(step) <= RISE[1] + 1e-3 for step in stairs.levels.diff().abs())
    up, down = re.compile(r"\b(up|climbs|ascends|top)\b"), re.compile(r"\b(down|descends|bottom)\b")
    for caption in copy.captions:
        assert bool(up.search(caption)) == (whole > 0) and bool(down.search(caption)) == (whole < 0)
    assert copy.label == "walk, climb"


def test_walks_up_and_down_do_not_jump() -> None:
    clip = recorded()
    own = float(clip.joints.diff(n=2, dim=0).norm(dim=-1).max())
    ways = set()
    for seed in range(12):
        copy = climbing(clip, random.Random(seed))
        if copy is None:  # some flights do not suit some walks
            continue
        assert float(copy.joints.diff(n=2, dim=0).norm(dim=-1).max()) < 1.5 * own
        assert float(copy.joints[..., 1].min()) > -1e-5 and copy.acts == ()
        ways.add(bool(copy.joints[-1, 0, 1] > copy.joints[0, 0, 1]))
    assert ways == {True, False}


def test_who_does_not_walk_does_not_climb() -> None:
    still = recorded().joints[:1].expand(100, -1, -1).clone()
    clip = Clip("a", still, ("a person stands.",), "cmu", "train", "stand", "free", True)
    assert climbing(clip, random.Random(0)) is None
