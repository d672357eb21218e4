"""Sentences along a motion: whose time is whose, and what is refused."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from scenectl.generators.prompts import Prompt, Prompts
from scenectl.generators.spec import Ability, Spec, check_request
from scenes.errors import UserError
from scenes.motion.motion import Pose2D

TIMELINE = Prompts((Prompt("walks", 1.0, 3.0), Prompt("turns", 4.0), Prompt("sits", 6.0, 8.0)))


@st.composite
def timelines(draw: st.DrawFn) -> Prompts:
    times = sorted(draw(st.lists(st.integers(0, 200), min_size=2, max_size=10, unique=True)))
    pairs = list(zip(times[::2], times[1::2], strict=False))
    ended = draw(st.lists(st.booleans(), min_size=len(pairs), max_size=len(pairs)))
    sentences = zip(pairs, ended, strict=True)
    return Prompts(tuple(Prompt(f"says {a}", a / 10, b / 10 if end else None) for (a, b), end in sentences))


@given(timelines(), st.floats(0.0, 25.0))
def test_one_sentence_is_about_any_time_and_each_about_its_own(prompts: Prompts, time: float) -> None:
    spans = prompts.spans()
    about = [p for p in spans if p.begin <= time and (p.end is None or time < p.end)]
    assert len(about) == 1 and [p.text for p in spans] == [p.text for p in prompts.sentences]
    for stated, span in zip(prompts.sentences, spans, strict=True):
        assert span.begin <= stated.begin and (span.end is None or stated.end is None or span.end >= stated.end)
    inside = [p for p in prompts.sentences if p.begin <= time and p.end is not None and time < p.end]
    assert not inside or inside[0].text == about[0].text


def test_gaps_go_to_the_nearer_sentence_and_are_told() -> None:
    assert [(p.begin, p.end) for p in TIMELINE.spans()] == [(0.0, 3.5), (3.5, 6.0), (6.0, None)]
    told = TIMELINE.doubts(10.0)
    assert [text.split(",")[0].split("about ")[1] for text in told] == ["0 to 1 s", "3 to 4 s", "8 to 10 s"]
    assert TIMELINE.doubts(7.0)[-1].startswith("prompt 'sits' ends at 8 s, after the motion")
    assert not Prompts.of("walks").doubts(5.0) and not Prompts((Prompt("a"), Prompt("b", 2.0))).doubts(5.0)


@given(timelines(), st.floats(0.0, 20.0), st.floats(0.1, 10.0), st.floats(0.0, 0.99))
def test_a_part_is_told_what_the_whole_is_then(prompts: Prompts, at: float, length: float, share: float) -> None:
    def said(told: Prompts, time: float) -> str:
        return next(p.text for p in reversed(told.spans()) if p.begin <= time)

    part, time = prompts.within(at, at + length), share * length
    if all(abs(p.begin - at - time) > 1e-6 for p in prompts.spans()):
        assert said(part, time) == said(prompts, at + time)


def test_a_sentence_about_all_stays_one_in_every_part() -> None:
    for prompts in (Prompts.of("walks"), TIMELINE.within(6.5, 7.0)):
        assert prompts.within(2.0, 5.0).single("any") == prompts.sentences[0].text == str(prompts)
    assert str(TIMELINE) == "1 s to 3 s: walks; 4 s: turns; 6 s to 8 s: sits"


def test_things_said_in_one_sentence_share_its_time() -> None:
    told = Prompts((Prompt("he walks, then waves", 0.0, 4.0), Prompt("he turns, sits down, and rests", 5.0)))
    apart = told.act_by_act(8.0)
    assert [(p.text, p.begin, p.end) for p in apart.sentences] == [
        ("he walks.", 0.0, 2.0), ("he waves.", 2.0, 4.0),
        ("he turns.", 5.0, 6.0), ("he sits down.", 6.0, 7.0), ("he rests.", 7.0, None),
    ]  # fmt: skip
    assert apart.act_by_act(8.0) == apart and TIMELINE.act_by_act(10.0) == TIMELINE
    for abilities, count in ((frozenset[Ability](), 1), (frozenset[Ability]({"sentences"}), 2)):
        spec = Spec(20.0, 1.0, 10.0, 10.0, abilities)
        assert len(check_request("any", spec, "he walks, then waves", 4.0, Pose2D(), 1)[0].sentences) == count


@pytest.mark.parametrize(
    ("sentences", "words"),
    [
        ((), "empty"),
        ((Prompt("a"), Prompt(" ", 2.0)), "empty"),
        ((Prompt("a", -1.0),), "from -1"),
        ((Prompt("a", 2.0, 2.0),), "end it after"),
        ((Prompt("a", float("nan")),), "begin it at 0"),
        ((Prompt("a", 0.0, 3.0), Prompt("b", 2.0)), "'b' begins at 2 s, and 'a' is from 0 to 3 s"),
        ((Prompt("a", 1.0), Prompt("b", 1.0)), "a time of its own"),
        ((Prompt("a", 4.0), Prompt("b", 1.0)), "in order"),
    ],
)
def test_times_that_cannot_be_are_refused(sentences: tuple[Prompt, ...], words: str) -> None:
    with pytest.raises(UserError, match=words):
        Prompts(sentences)


def test_several_sentences_are_for_those_who_can() -> None:
    here, can = Pose2D(), Spec(20.0, 1.0, 10.0, 5.0, frozenset({"sentences"}))
    assert check_request("x", can, TIMELINE, 7.0, here, 1) == (TIMELINE, 140)
    with pytest.raises(UserError, match="begins at 6 s, and the motion lasts 6 s"):
        check_request("x", can, TIMELINE, 6.0, here, 1)
    with pytest.raises(UserError, match="takes one sentence"):
        check_request("x", Spec(20.0, 1.0, 10.0, 5.0), TIMELINE, 7.0, here, 1)
