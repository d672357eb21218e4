"""Picking up and putting down: hands come to one place and stay there, knees and elbows bend as they do, feet stay."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest
import torch

from scenectl.data.corpus import Clip
from scenectl.data.edits.limbs import chest
from scenectl.data.edits.picking import any_grasp, fetching, picking_up, putting_down
from scenectl.data.features import FPS, to_uniform_skeleton
from scenectl.data.kinds import EDITS
from tests.scenectl.data.edits.people import arriving, between, standing
from tests.scenectl.small import walk

FEET, WRISTS = [7, 8, 10, 11], [20, 21]
Maker = Callable[[Clip, random.Random], Clip | None]
MAKERS = [picking_up, putting_down]


def all_made(maker: Maker, clip: Clip, seeds: int = 12) -> list[Clip]:
    made = [copy for seed in range(seeds) if (copy := maker(clip, random.Random(seed))) is not None]
    assert len(made) > seeds // 3
    return made


@pytest.mark.parametrize("maker", MAKERS)
def test_bones_keep_their_lengths_feet_stay_and_nothing_jumps(maker: Maker) -> None:
    for copy in all_made(maker, standing()):
        joints = copy.joints
        torch.testing.assert_close(to_uniform_skeleton(joints), joints, atol=2e-3, rtol=0)
        assert float(joints[:, FEET].diff(dim=0).norm(dim=-1).max()) < 2e-3
        assert float(joints[..., 1].min()) > -0.01
        # HDM05's people who grab and deposit: largest accelerations of wrists of 5 to 28 m/s^2.
        assert float(joints[:, WRISTS].diff(n=2, dim=0).norm(dim=-1).max()) * FPS**2 < 20.0


@pytest.mark.parametrize("maker", MAKERS)
def test_hands_come_to_one_place_at_its_height(maker: Maker) -> None:
    for seed in range(12):
        grasp = any_grasp(random.Random(seed))
        copy = maker(standing(), random.Random(seed))
        if copy is None:
            continue
        for side in grasp.hold.sides:
            there = copy.joints[grasp.times[1] : grasp.times[2], WRISTS[side == "right"]]
            assert float((there - there[0]).norm(dim=-1).max()) < 0.02
            height = there[:, 1].mean() - copy.joints[:, [10, 11], 1].min()
            assert abs(float(height) - grasp.height - 0.08) < 0.03


@pytest.mark.parametrize("maker", MAKERS)
def test_knees_bend_forward_and_wrists_stay_out_of_the_trunk(maker: Maker) -> None:
    for copy in all_made(maker, standing()):
        joints = copy.joints
        ahead = joints[:, [4, 5], 2] - (joints[:, [1, 2], 2] + joints[:, [7, 8], 2]) / 2
        assert float(ahead.min()) > -0.01
        left, up, forward = chest(joints)
        arm = joints[:, WRISTS] - joints[:, 3, None]
        x, y, z = ((arm * axis[:, None]).sum(-1) for axis in (left, up, forward))
        inside = (y > 0.0) & (y < 0.4) & ((x / 0.15).square() + (z / 0.11).square() < 1.0)
        assert not inside.any()


def test_floors_ask_for_more_than_shelves() -> None:
    drops: dict[bool, list[float]] = {True: [], False: []}
    for seed in range(30):
        copy = picking_up(standing(), random.Random(seed))
        if copy is not None:
            head = copy.joints[:, 15, 1]
            drops[any_grasp(random.Random(seed)).height < 0.6].append(float(head[0] - head.min()))
    assert min(drops[True]) > max(drops[False])


def test_the_same_seed_makes_the_same_clip_and_others_make_others() -> None:
    first, again = (all_made(picking_up, standing()) for _ in range(2))
    for a, b in zip(first, again, strict=True):
        assert torch.equal(a.joints, b.joints) and a.captions == b.captions
    assert len({copy.captions for copy in first}) == len(first)


@pytest.mark.parametrize(
    ("maker", "words"), [(picking_up, ("pick", "lift", "take")), (putting_down, ("put", "place", "set"))]
)
def test_captions_say_what_the_hands_do(maker: Maker, words: tuple[str, ...]) -> None:
    for seed in range(12):
        grasp, copy = any_grasp(random.Random(seed)), maker(standing(), random.Random(seed))
        for text in copy.captions if copy else ():
            assert any(word in text for word in words) and grasp.thing in text
            assert text.endswith(".") and not any(
                f"{side} hand" in text for side in {"left", "right"} - {*grasp.hold.sides}
            )


@pytest.mark.parametrize("maker", MAKERS)
def test_after_a_walk_there_are_acts_that_cover_the_clip(maker: Maker) -> None:
    for copy in all_made(maker, arriving()):
        assert [act.begin for act in copy.acts] == [0, *(act.end for act in copy.acts[:-1])]
        assert copy.acts[-1].end == copy.frames and len(copy.acts) == 2
        assert all("walk" in text or "carries" in text for text in copy.acts[0].captions)


def test_a_thing_is_fetched_from_one_stand_to_the_next() -> None:
    made = all_made(fetching, between())
    assert all(len(copy.acts) == 3 and copy.acts[-1].end == copy.frames for copy in made)
    assert all(copy.label.endswith(", composed") for copy in made)


@pytest.mark.parametrize("maker", [*MAKERS, fetching])
def test_who_never_stands_picks_up_nothing(maker: Maker) -> None:
    clip = Clip("a", walk(120), ("a person walks.",), "cmu", "train", "walk", "free", True)
    assert maker(clip, random.Random(0)) is None
    assert "reach standing" in EDITS
