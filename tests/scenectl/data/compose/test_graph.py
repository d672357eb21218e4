"""Composed sequences: acts cover them, seams are as smooth as the rest, feet stay planted, and the words fit."""

from __future__ import annotations

import random
from dataclasses import replace
from functools import cache
from itertools import pairwise

import pytest
import torch

from scenectl.data.compose import composed
from scenectl.data.compose.grammar import ActKind, act_of, may_follow
from scenectl.data.compose.graph import FRAMES, LEVEL, QUIET, SMOOTH
from scenectl.data.corpus import Act, Clip
from scenectl.data.edits.limbs import bump, lowered
from scenectl.data.features import canonicalise, to_uniform_skeleton
from scenectl.data.seams import HALF, accelerations, floors, seam_ratio, standing
from scenes.motion.skeleton import FEET, HUMANML3D
from tests.scenectl.small import walk


def clip(name: str, label: str, *captions: str, joints: torch.Tensor | None = None, **changes: object) -> Clip:
    joints = canonicalise(walk(150)) if joints is None else joints
    return Clip(**{"id": name, "joints": joints, "captions": captions, "source": "cmu", "split": "train",
                   "label": label, "licence": "free", "commercial_ok": True} | changes)  # fmt: skip


@cache
def people() -> tuple[Clip, ...]:
    """Walks, walks with a duck, and someone who stands, squats and sits: all of one body."""
    still = to_uniform_skeleton(canonicalise(walk(150))[8:9]).repeat(80, 1, 1)
    still[:, 16:] += 0.02 * torch.sin(torch.arange(80) / 6.0)[:, None, None]  # arms sway
    still = to_uniform_skeleton(still)
    low = bump(still, random.Random(0), hold=(0.2, 0.4))
    assert low is not None
    squat = lowered(still, 0.3 * low, 0.4 * low)
    seat = lowered(still, still.new_full((80,), 0.35), still.new_zeros(80))
    down = lowered(still, 0.35 * torch.linspace(0, 1, 80).clamp(0.2, 0.8).sub(0.2).div(0.6), still.new_zeros(80))
    ducks = canonicalise(walk(100))
    dip = bump(ducks, random.Random(1), hold=(0.2, 0.4))
    assert dip is not None
    return (
        clip("walk", "walk", "a person walks forward.", "someone is walking, then not."),
        clip("duck~duck", "walk, duck", "a person ducks under something.", joints=lowered(ducks, 0.3 * dip, 0.5 * dip)),
        clip("idle~idle", "walk, idle", "someone stands still.", joints=still, source="snu", licence="MIT"),
        clip("squat", "squat1Reps", "a person squats.", joints=squat, source="x", licence="none", commercial_ok=False),
        clip("down~a", "x, sit down", "a person sits down.", joints=down),
        clip("sit~a", "x, sit", "a person sits.", joints=seat),
        clip("up~a", "x, stand up", "a person stands up.", joints=down.flip(0)),
    )


@cache
def made() -> tuple[Clip, ...]:
    return tuple(composed(people(), random.Random(0), 0.03))


def test_acts_cover_each_sequence_and_its_sentences_say_them_all() -> None:
    verbs = {"walk": "walk", "duck": "duck", "idle": "stand", "squat": "squat", "sit down": "sit", "sit": "sit",
             "stand up": "stand"}  # fmt: skip
    assert len(made()) > 8
    for each in made():
        assert FRAMES[0] <= each.frames <= FRAMES[1] and "~" in each.id
        assert 2 <= len(each.acts) <= 4
        assert [act.begin for act in each.acts] == [0, *(act.end for act in each.acts[:-1])]
        assert each.acts[-1].end == each.frames
        *names, last = each.label.split(", ")
        assert last == "composed" and len(names) == len(each.acts)
        for name, act in zip(names, each.acts, strict=True):
            assert verbs[name] in act.captions[0]
        inner = [i for i, name in enumerate(names) if name not in ("idle", "sit")]
        told = names[inner[0] : inner[-1] + 1] if inner else names  # rests at the ends may be left unsaid
        assert all(text.count(".") == 1 and all(verbs[n] in text for n in told) for text in each.captions)
    fully = [all(verbs[n] in text for n in each.label.split(", ")[:-1]) for each in made() for text in each.captions]
    assert sum(fully) > 0.6 * len(fully)


def test_only_what_makes_sense_follows() -> None:
    labels = [each.label.split(", ")[:-1] for each in made()]
    follows = {pair for names in labels for pair in pairwise(names)}
    assert ("sit down", "sit") in follows and ("sit", "stand up") in follows
    seated = {"sit down", "sit"}
    assert all((a in seated) == (b in {"sit", "stand up"}) for a, b in follows)


def test_seams_are_as_smooth_as_the_rest_and_bones_and_floor_stay() -> None:
    for each in made():
        seams = [act.begin for act in each.acts[1:]]
        sizes = accelerations(each.joints)
        assert seam_ratio(each.joints, seams) < SMOOTH + 0.01 or max(sizes[s - 5 : s + 6].max() for s in seams) < QUIET
        torch.testing.assert_close(to_uniform_skeleton(each.joints), each.joints, atol=2e-3, rtol=0)
        assert float(each.joints[..., 1].min()) > -1e-4


def test_feet_that_stand_through_a_blend_stay_where_they_are() -> None:
    feet, held = HUMANML3D.indices(FEET), 0
    for each in made():
        still = [n in ("idle", "squat", "sit down", "sit", "stand up") for n in each.label.split(", ")[:-1]]
        for act, a, b in zip(each.acts[1:], still[:-1], still[1:], strict=True):
            if a and b:
                window = each.joints[act.begin - HALF : act.begin + HALF + 1][:, feet]
                assert float((window - window[0])[..., [0, 2]].norm(dim=-1).max()) < 5e-3
                held += 1
    assert held > 3


def test_terms_of_the_parts_are_the_terms_of_the_whole() -> None:
    mixed = [each for each in made() if " + " in each.source]
    assert mixed
    for each in made():
        sources = each.source.split(" + ")
        assert len(sources) == len(each.licence.split(" + ")) == len(set(sources))
        assert each.commercial_ok == ("squat" not in each.label)
        assert ("x" in sources) == ("squat" in each.label)


def test_the_same_chance_makes_the_same_clips() -> None:
    again = composed(people(), random.Random(0), 0.005)
    for a, b in zip(again, made(), strict=False):
        assert (a.id, a.captions) == (b.id, b.captions)
        assert torch.equal(a.joints, b.joints)
    assert composed([], random.Random(0), 1.0) == []
    assert composed(people()[:1], random.Random(0), 1.0) == []  # a walk goes on as nothing else


def test_floors_agree_where_pieces_meet() -> None:
    """Somebody at the top of stairs joins nothing below, and nobody floats or sinks."""
    rise = torch.linspace(0, 1, 60).clamp(0.3, 0.7).sub(0.3).div(0.4)[:, None, None] * torch.tensor([0.0, 0.5, 0.0])
    climb = people()[2].joints[:60] + rise
    stairs = clip("climb~a", "x, climb", "a person climbs the stairs.", joints=climb)
    clips = composed([*people()[1:4], stairs], random.Random(0), 0.01)
    assert any("climb" in each.label for each in clips)
    for each in clips:
        height = floors(each.joints)
        for act in each.acts[1:]:
            assert abs(height[act.begin + HALF] - height[act.begin - HALF]) < LEVEL


def test_acts_within_a_piece_are_told() -> None:
    walks = people()[0]
    acts = (Act(0, 60, ("a person walks.",)), Act(60, 100, ("a person strides.",)))
    stops = replace(walks, id="s~stop", label="walk, stop", joints=walks.joints[:100], acts=acts)
    clips = composed([people()[1], stops], random.Random(0), 0.005)
    assert clips
    for each in clips:
        kinds = each.label.split(", ")[:-1]
        assert len(each.acts) == len(kinds) + kinds.count("stop")
        assert [act.begin for act in each.acts[1:]] == [act.end for act in each.acts[:-1]]
        assert all("walk" in text and "strid" in text and "duck" in text for text in each.captions)


@pytest.mark.parametrize(
    ("first", "second", "fits"),
    [
        (("x, sit down", "a person sits down."), ("x, stand up", "a person stands up."), True),
        (("x, stand up", "a person stands up."), ("x, sit", "a person sits."), False),
        (("x, pick up", "a person picks up a box."), ("x, carry", "someone carries a box."), True),
        (("x, pick up", "a person picks up a box."), ("x, carry", "someone carries a bag."), False),
        (("x, pick up", "a person picks up a box."), ("walk", "a person walks."), False),
        (("x, put down", "a person puts a box down."), ("walk", "a person walks."), True),
        (("walk", "a person walks."), ("walk", "a person strides."), False),
    ],
)
def test_states_and_things_agree(first: tuple[str, str], second: tuple[str, str], fits: bool) -> None:
    one, two = (act_of(clip("a~1" if "," in label else "a", label, text)) for label, text in (first, second))
    assert isinstance(one, ActKind) and isinstance(two, ActKind)
    assert may_follow(one, two) is fits


def test_clips_whose_words_do_not_fit_have_no_part() -> None:
    assert act_of(clip("a", "walk", "walk")) is None  # a title
    assert act_of(clip("a", "walk", "a person walks and turns around.")) is None  # not of any stretch
    assert act_of(clip("a~1", "walk, wave, composed", "a person walks and waves.")) is None
    assert act_of(clip("a", "cartwheel", "a person does a cartwheel.")) is None


def test_standing_needs_a_low_and_slow_foot() -> None:
    joints = people()[0].joints
    stands = standing(joints, floors(joints))
    moves = joints[:, HUMANML3D.indices(FEET)].diff(dim=0).norm(dim=-1).numpy()
    assert stands.any(0).all() and not stands.all(0).any()
    assert moves[stands[1:] & stands[:-1]].max() < 0.015
