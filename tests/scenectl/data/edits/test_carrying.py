"""Carrying: hands that hold a thing keep their place on a body that moves, and what they hold keeps its width."""

from __future__ import annotations

import random

import torch

from scenectl.data.corpus import Clip
from scenectl.data.edits.carrying import carrying
from scenectl.data.edits.handling import any_hold
from scenectl.data.features import canonicalise, to_uniform_skeleton
from tests.scenectl.data.edits.people import standing
from tests.scenectl.small import walk

WRISTS, LEGS = [20, 21], [1, 2, 4, 5, 7, 8, 10, 11]


def walker() -> Clip:
    return Clip("a", canonicalise(walk(100)), ("a person walks.",), "cmu", "train", "walk", "free", True)


def test_bones_keep_their_lengths_and_legs_walk_on() -> None:
    for seed in range(10):
        copy = carrying(walker(), random.Random(seed))
        assert copy is not None
        torch.testing.assert_close(to_uniform_skeleton(copy.joints), copy.joints, atol=2e-3, rtol=0)
        torch.testing.assert_close(copy.joints[:, LEGS], walker().joints[:, LEGS])


def test_what_two_hands_hold_keeps_its_width_and_what_one_holds_leaves_the_other_free() -> None:
    ways = set()
    for seed in range(16):
        hold, copy = any_hold(random.Random(seed)), carrying(walker(), random.Random(seed))
        assert copy is not None
        ways.add(len(hold.sides))
        if len(hold.sides) == 2:
            width = (copy.joints[:, 20] - copy.joints[:, 21]).norm(dim=-1)
            assert float(width.min()) > 0.17 and float(width.max() - width.min()) < 0.03
            assert "hand" in copy.captions[0] or "arms" in copy.captions[0] or "in front" in copy.captions[0]
            continue
        held, free = (20, 21) if hold.sides == ("left",) else (21, 20)
        swing = [(c.joints - c.joints[:, :1])[:, held].std(0).norm() for c in (copy, walker())]
        assert 0.0 < float(swing[0]) < float(swing[1])
        assert float((copy.joints - walker().joints)[:, free].norm(dim=-1).max()) < 0.1
        assert hold.sides[0] in copy.captions[0]
    assert ways == {1, 2}


def test_people_who_stand_hold_things_too_and_are_never_frozen() -> None:
    for seed in range(6):
        copy = carrying(standing(), random.Random(seed))
        assert copy is not None and copy.label.endswith(", carry")
        assert float(copy.joints[:, WRISTS].std(0).norm(dim=-1).min()) > 1e-3
