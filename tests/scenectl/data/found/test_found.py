"""Pieces found in recordings: each shows what it is called, none comes from takes set aside unless asked for."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
import torch

from scenectl.data import held_out as takes
from scenectl.data.corpus import Clip, load_motions
from scenectl.data.features import canonicalise
from scenectl.data.found import found, held_out
from scenectl.data.found.pieces import SHORTEST
from scenectl.data.found.traits import FEET, Traits, bends
from scenectl.data.kinds import kind_of
from scenectl.data.sentences import SUBJECT
from scenes.motion.skeleton import HUMANML3D
from tests.scenectl.small import walk

KINDS = {
    "idle", "stop", "start", "turn in place", "sit down", "sit", "stand up", "climb", "put down", "pick up", "composed",
}  # fmt: skip
SOME = (
    "14_32", "13_35", "snu_w2_walk_normal_to_slope", "snu_w2_walk_normal_left_45", "HDM_bd_depositFloorR_001_120",
    "HDM_bd_grabHighR_001_120", "91_01", "m2m_Sitting_Chain", "dm_walk",
)  # fmt: skip


@cache
def recorded(folder: Path) -> tuple[Clip, ...]:
    """A few takes that have all kinds."""
    return tuple(clip for clip in load_motions(folder) if clip.id in SOME)


@cache
def pieces(folder: Path) -> tuple[Clip, ...]:
    return tuple(found(recorded(folder)))


@pytest.fixture
def made(shared: Path) -> tuple[Clip, ...]:
    return pieces(shared / "data" / "motions")


def of(made: tuple[Clip, ...], kind: str) -> list[Clip]:
    some = [clip for clip in made if kind_of(clip) == kind]
    assert some
    return some


def test_pieces_are_whole_clips_of_their_own(made: tuple[Clip, ...]) -> None:
    assert {kind_of(clip) for clip in made} == KINDS
    assert len({clip.id for clip in made}) == len(made)
    for clip in made:
        assert "~" in clip.id and clip.frames >= SHORTEST and clip.split == "train"
        torch.testing.assert_close(clip.joints, canonicalise(clip.joints), atol=1e-4, rtol=0)
        for parent, child in HUMANML3D.bones:
            bone = (clip.joints[:, child] - clip.joints[:, parent]).norm(dim=-1)
            assert float((bone - float(HUMANML3D.bone_lengths[child])).abs().max()) < 4e-3
        assert len(set(clip.captions)) == len(clip.captions) >= 2
        for text in clip.captions:
            assert SUBJECT.match(text) or clip.acts  # which may begin with what comes before or after
            assert text.endswith(".") and "{" not in text and text == text.lower()


def test_acts_cover_their_clip(made: tuple[Clip, ...]) -> None:
    for clip in (*of(made, "stop"), *of(made, "start"), *of(made, "composed")):
        edges = [0, *(act.end for act in clip.acts)]
        assert [act.begin for act in clip.acts] == edges[:-1] and edges[-1] == clip.frames
        assert all(act.begin < act.end and act.captions for act in clip.acts)


def test_who_stands_idle_stands_and_is_never_frozen(made: tuple[Clip, ...]) -> None:
    for clip in of(made, "idle"):
        joints, traits = clip.joints, Traits.of(clip.joints)
        assert 60 <= clip.frames <= 200
        steps = joints.diff(dim=0).norm(dim=-1)
        assert float(steps.amax(1).min()) > 5e-5  # something moves from each frame to the next
        assert float(steps[:, FEET].max()) < 0.012
        assert 0.002 < float(joints[:, 0, [0, 2]].std(0).norm()) < 0.05
        assert bends(joints.double().numpy()).max() < 25 and traits.arms.max() < 55
        flat = joints.flatten(1)
        apart = torch.cdist(flat, flat, compute_mode="donot_use_mm_for_euclid_dist") + torch.eye(clip.frames)
        assert float(apart.min()) > 1e-4  # no frame comes back exactly
        assert float(joints.diff(n=2, dim=0).norm(dim=-1).max()) < 0.02


def test_stops_end_and_starts_begin_at_rest(made: tuple[Clip, ...]) -> None:
    for clip in of(made, "stop"):
        speed = Traits.of(clip.joints).speed
        assert speed[-6:].max() < 0.25 < 0.4 < speed[: clip.acts[0].end].max()
    for clip in of(made, "start"):
        speed = Traits.of(clip.joints).speed
        assert speed[:6].max() < 0.25 < 0.4 < speed[clip.acts[1].begin :].max()


def test_turns_turn_to_the_side_they_name_and_stay(made: tuple[Clip, ...]) -> None:
    for clip in of(made, "turn in place"):
        heading = Traits.of(clip.joints).heading
        side = "left" if heading[-1] > heading[0] else "right"
        assert all(side in text for text in clip.captions)
        assert abs(heading[-1] - heading[0]) > 0.5


def test_sitting_goes_down_stays_and_comes_up(made: tuple[Clip, ...]) -> None:
    def ends(clip: Clip) -> tuple[float, float]:
        return float(clip.joints[:6, 0, 1].mean()), float(clip.joints[-6:, 0, 1].mean())

    for clip in of(made, "sit down"):
        before, after = ends(clip)
        assert after < before - 0.08
    for clip in of(made, "stand up"):
        before, after = ends(clip)
        assert after > before + 0.08
    for clip in of(made, "sit"):
        assert float(clip.joints[:, 0, 1].max() - clip.joints[:, 0, 1].min()) < 0.08
        assert float(clip.joints.diff(dim=0).norm(dim=-1).amax(1).min()) > 1e-5


def test_climbs_say_up_and_down_as_they_go(made: tuple[Clip, ...]) -> None:
    for clip in of(made, "climb"):
        up = clip.joints[-1, 0, 1] > clip.joints[0, 0, 1]
        words = ("down", "descends") if up else ("climbs up", "up ", "ascends", "upstairs")
        assert not any(word in text for text in clip.captions for word in words)


def test_hands_are_where_captions_say(made: tuple[Clip, ...]) -> None:
    for clip in of(made, "put down"):
        assert float(clip.joints[:, [20, 21], 1].min()) < 0.55
    for clip in of(made, "pick up"):
        assert float((clip.joints[:, [20, 21], 1]).max()) > float(clip.joints[:, 15, 1].median()) - 0.15


def test_the_same_pieces_are_found_again_and_by_themselves(shared: Path, made: tuple[Clip, ...]) -> None:
    clip = next(c for c in recorded(shared / "data" / "motions") if c.id == "14_32")
    again = {c.id: c for c in found([clip])}
    for before in (c for c in made if c.id.startswith("14_32~")):
        assert torch.equal(again[before.id].joints, before.joints) and again[before.id].captions == before.captions


def test_pieces_to_test_with_come_from_takes_that_are_never_trained_on(
    shared: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scenectl.data.found.found", list)  # which takes are searched, not what is found in them
    searched = held_out(shared / "data" / "motions")
    assert {clip.split for clip in searched} == {takes.SPLIT, "test"}
    assert {(clip.source, clip.id) for clip in searched if clip.split == takes.SPLIT} == set(takes.TAKES)


def test_nothing_is_found_where_nothing_is_shown() -> None:
    walks = Clip("a", canonicalise(walk(120)), ("a person sits down.",), "own", "train", "", "free", True)
    assert not found([walks])  # says that it sits, and does not
    assert not found([replace(walks, joints=walks.joints[: SHORTEST - 1])])


def test_a_walk_that_is_no_longer_recorded_has_the_kind_of_its_recording() -> None:
    clip = Clip("14_30", walk(40), ("x",), "cmu", "train", "sit on stepstool, stand up", "free", True)
    for name in ("14_30", "14_30~m", "14_30~b+0.12~s1.05", "14_30~repeat~m"):
        assert kind_of(replace(clip, id=name)) == "sit and kneel"
    for name in ("14_30~stand-up12", "14_30~stand-up12~m"):
        assert kind_of(replace(clip, id=name)) == "stand up"
