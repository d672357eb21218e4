"""Pieces that sit down or stand up say when they only sit."""

from __future__ import annotations

import pytest
import torch

from scenectl.data.corpus import Clip
from scenectl.data.settling import LEAST, SEATED, settled

DOWN = ("a person sits down.",)


def sitting(name: str, way: int, rest: int) -> Clip:
    """A pelvis that sinks for `way` frames and stays for `rest`, or the other way round."""
    height = torch.cat([torch.linspace(0.95, 0.5, way), torch.full((rest,), 0.5)])
    joints = torch.zeros(way + rest, 22, 3)
    joints[:, 0, 1] = height if name == "sit down" else height.flip(0)
    return Clip("a~x", joints, DOWN, "cmu", "train", f"sit, {name}", "free", True)


@pytest.mark.parametrize(("name", "told"), [("sit down", [DOWN, SEATED]), ("stand up", [SEATED, DOWN])])
def test_the_seated_part_is_told_of_as_sitting(name: str, told: list[tuple[str, ...]]) -> None:
    clip = settled(sitting(name, 20, 40))
    assert [act.captions for act in clip.acts] == told
    first, second = clip.acts
    assert (first.begin, first.end, second.end) == (0, second.begin, 60)
    seated = first if first.captions == SEATED else second
    assert 40 <= seated.end - seated.begin <= 44
    assert clip.captions == DOWN  # all of it is still sitting down


def test_a_moment_on_the_seat_belongs_to_the_way() -> None:
    short = sitting("sit down", 30, LEAST - 8)
    assert settled(short) is short


def test_what_sits_all_through_or_walks_is_left_alone() -> None:
    for label in ("sit, sit", "walk"):
        clip = sitting("sit down", 20, 40)
        other = Clip(clip.id, clip.joints, clip.captions, "cmu", "train", label, "free", True)
        assert settled(other) is other
