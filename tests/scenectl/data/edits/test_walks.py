"""Pose edits: bones keep their lengths, planted feet stay planted, and each edit does what its caption says."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from scenectl.data.corpus import Clip
from scenectl.data.edits.limbs import axes, pitched
from scenectl.data.edits.walks import crouched, ducking, reaching, sidestepping
from scenectl.data.features import canonicalise, to_uniform_skeleton
from scenes.motion.skeleton import HUMANML3D
from tests.scenectl.small import walk

PELVIS, HEAD, FEET = 0, 15, [10, 11]
KNEES, ANKLES, HIPS = [4, 5], [7, 8], [1, 2]
EDITS = [crouched, ducking, sidestepping, reaching]
Edit = Callable[[Clip, random.Random], Clip | None]


def made(edit: Edit, seed: int, frames: int = 120) -> tuple[Clip, Clip]:
    clip = Clip("a", canonicalise(walk(frames)), ("a person walks.",), "cmu", "train", "walk", "free", True)
    copy = edit(clip, random.Random(seed))
    assert copy is not None
    return clip, copy


def planted(joints: Tensor) -> Tensor:
    """Transitions in which a foot stands, ``[T - 1, 2]``."""
    return joints[:, FEET].diff(dim=0).norm(dim=-1) < 2e-3


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("edit", EDITS)
def test_bones_keep_their_lengths_and_planted_feet_stay(edit: Edit, seed: int) -> None:
    clip, copy = made(edit, seed)
    torch.testing.assert_close(to_uniform_skeleton(copy.joints), copy.joints, atol=2e-3, rtol=0)
    stand = planted(clip.joints)
    assert stand.any()
    if edit is sidestepping:  # which takes its feet elsewhere: they stand as long there
        stand = planted(copy.joints)
        assert float(stand.float().mean()) > 0.3
    assert float(copy.joints[:, FEET].diff(dim=0).norm(dim=-1)[stand].max()) < 4e-3
    assert float(copy.joints[..., 1].min()) > -0.01


@pytest.mark.parametrize("edit", [crouched, ducking, reaching])
def test_feet_stay_where_they_were(edit: Edit) -> None:
    clip, copy = made(edit, 0)
    torch.testing.assert_close(copy.joints[:, ANKLES + FEET], clip.joints[:, ANKLES + FEET])


def test_a_crouch_lowers_the_body_all_the_way_and_bends_knees_forward() -> None:
    clip, copy = made(crouched, 0)
    drop = clip.joints[:, PELVIS, 1] - copy.joints[:, PELVIS, 1]
    assert float(drop.min()) > 0.08 and float(drop.max()) < 0.4
    middle = (copy.joints[:, HIPS] + copy.joints[:, ANKLES]) / 2
    ahead = (copy.joints[:, KNEES] - middle)[..., 2]
    assert float(ahead.min()) > 0.0
    assert copy.captions[0].startswith("a person walks ") and "crouch" in copy.captions[0]


def test_a_duck_passes() -> None:
    clip, copy = made(ducking, 1)
    drop = clip.joints[:, HEAD, 1] - copy.joints[:, HEAD, 1]
    assert float(drop.max()) > 0.25
    torch.testing.assert_close(copy.joints[0], clip.joints[0], atol=1e-3, rtol=0)
    torch.testing.assert_close(copy.joints[-1], clip.joints[-1], atol=1e-3, rtol=0)


def test_sidesteps_go_the_way_that_the_caption_says_and_keep_facing_forward() -> None:
    sides = set()
    for seed in range(8):
        _, copy = made(sidestepping, seed)
        way = float(copy.joints[-1, PELVIS, 0] - copy.joints[0, PELVIS, 0])
        side = "left" if way > 0 else "right"
        assert abs(way) > 0.3 and all(side in caption for caption in copy.captions)
        hips = copy.joints[:, HIPS[0]] - copy.joints[:, HIPS[1]]
        assert float(hips[:, 0].min()) > 0.15
        sides.add(side)
    assert sides == {"left", "right"}


@pytest.mark.parametrize("seed", range(8))
def test_legs_of_sidesteps_never_cross(seed: int) -> None:
    _, copy = made(sidestepping, seed)
    for left, right in (ANKLES, FEET):
        assert float((copy.joints[:, left] - copy.joints[:, right])[:, 0].min()) > 0.08


def test_bodies_that_bend_down_do_not_sidestep() -> None:
    clip, _ = made(sidestepping, 0)
    bowed = pitched(clip.joints, *axes(clip.joints)[:1], torch.full((clip.frames,), 1.2))
    assert sidestepping(replace(clip, joints=bowed), random.Random(0)) is None


def test_a_reach_leads_the_named_hand_out_and_back() -> None:
    for seed in range(8):
        clip, copy = made(reaching, seed)
        moved = (copy.joints - clip.joints).norm(dim=-1).amax(0)
        hand, other = (20, 21) if "left" in copy.captions[0] else (21, 20)
        shoulder = hand - 4
        far = (copy.joints[:, hand] - copy.joints[:, shoulder]).norm(dim=-1)
        assert float(far.max()) > 0.42  # 0.8 of an arm
        assert float(moved[hand]) > 0.2 > float(moved[other])
        # A straight arm does not say where its elbow is: that one may differ by its last bend.
        torch.testing.assert_close(copy.joints[[0, -1]], clip.joints[[0, -1]], atol=2e-2, rtol=0)


def test_clips_that_an_edit_does_not_suit_are_left_alone() -> None:
    short = Clip("a", canonicalise(walk(12)), ("a person walks.",), "cmu", "train", "walk", "free", True)
    assert ducking(short, random.Random(0)) is None
    assert sidestepping(short, random.Random(0)) is None
    low = canonicalise(walk(80)) - torch.tensor([0.0, 0.3, 0.0])  # through its own floor
    assert crouched(Clip("b", low, ("x",), "cmu", "train", "walk", "free", True), random.Random(0)) is None


def test_legs_too_short_for_a_step_lower_the_body() -> None:
    _, copy = made(sidestepping, 3)
    thigh, shin = HUMANML3D.bone_lengths[KNEES[0]], HUMANML3D.bone_lengths[ANKLES[0]]
    reach = (copy.joints[:, HIPS] - copy.joints[:, ANKLES]).norm(dim=-1)
    assert float(reach.max()) <= thigh + shin + 1e-4


@pytest.mark.parametrize("edit", [ducking, reaching])
@pytest.mark.parametrize("seed", range(4))
def test_what_is_done_on_the_way_is_told_when_it_is_done(edit: Edit, seed: int) -> None:
    clip, copy = made(edit, seed)
    assert [copy.acts[0].begin, *(act.end for act in copy.acts)] == [0, *(act.begin for act in copy.acts[1:]), 120]
    other = [act for act in copy.acts if act.captions != clip.captions]
    moved = (copy.joints - clip.joints).norm(dim=-1).amax(-1)
    (act,) = other
    assert act.begin <= int(moved.argmax()) < act.end
    outside = torch.cat([moved[: act.begin], moved[act.end :]])
    assert float(outside.max()) < 0.35 * float(moved.max())
