"""Several things said in one sentence."""

from __future__ import annotations

import re

import pytest

from scenectl.data.sentences import apart, doing, in_one

WALKS = ("a person walks forward.", "someone walks ahead.")
SITS = ("a person sits down on a chair.",)
WAVES = ("the person waves.", "a person waves with the right hand")


def test_all_is_said_in_order_with_one_subject_and_one_full_stop() -> None:
    for text in in_one([WALKS, SITS, WAVES], most=60):
        places = [
            re.search(verb, text) for verb in ("walk(s|ing) (forward|ahead)", "sits down on a chair", "wav(es|ing)")
        ]
        assert [place is not None for place in places] == [True] * 3
        assert sorted(place.start() for place in places if place) == [place.start() for place in places if place]
        assert text.count(".") == 1 and text.endswith(".")
        assert sum(text.count(subject) for subject in ("a person", "someone", "the person")) == 1


def test_the_order_of_words_turns_only_with_a_word_for_it() -> None:
    texts = set(in_one([WALKS[:1], SITS], most=60))
    assert "after walking forward, a person sits down on a chair." in texts
    assert "a person sits down on a chair after walking forward." in texts
    assert "a person walks forward before sitting down on a chair." in texts
    for text in texts:
        assert (text.index("sit") < text.index("walk")) == text.startswith("a person sits")


@pytest.mark.parametrize(
    ("says", "does"),
    [
        ("walks forward", "walking forward"), ("sits down", "sitting down"), ("waves", "waving"), ("runs", "running"),
        ("carries a box", "carrying a box"), ("lies down", "lying down"), ("crouches", "crouching"),
        ("stops", "stopping"), ("is walking", "walking"), ("slowly gets up", "slowly getting up"),
        ("squats", "squatting"),
        ("tiptoes", "tiptoeing"), ("does a bow", "doing a bow"), ("throws a ball", "throwing a ball"),
        ("raises a hand", "raising a hand"), ("leans", "leaning"), ("is seated", None), ("walks and waves", None),
        ("a title", None), ("starts to walk", None), ("dances", "dancing"), ("passes by", "passing by"),
    ],
)  # fmt: skip
def test_participles(says: str, does: str | None) -> None:
    assert doing(says) == does


def test_wordings_vary_and_are_the_same_again() -> None:
    made = in_one([WALKS, SITS, WAVES], most=30)
    assert len(made) == len(set(made)) > 8
    assert made == in_one([WALKS, SITS, WAVES], most=30)


def test_rests_at_the_ends_may_be_left_unsaid() -> None:
    stands, seated = ("a person stands still.", "someone waits."), ("a person sits.", "the person remains seated.")
    texts = set(in_one([stands, SITS, seated], most=60))
    unsaid = [text for text in texts if not re.search("stand|wait|sits\\.|sits (before|after)|seated|sitting", text)]
    assert unsaid == ["a person sits down on a chair."] and len(texts) > 6
    for between in ([WALKS, stands, WAVES], [WALKS, WAVES]):  # one on the way is told
        assert all(len(re.findall("walk|stand|wait|wav", text)) == len(between) for text in in_one(between, most=60))
    assert all(re.search("still|wait", text) for text in in_one([stands], most=20))
    leans = ("a person stands and leans on a wall.",)
    assert all("lean" in text for text in in_one([leans, SITS], most=20))


def test_one_thing_is_said_as_it_is() -> None:
    assert in_one([SITS]) == SITS


def test_what_was_said_in_one_comes_apart_in_order() -> None:
    texts = [text for text in in_one([WALKS, SITS, WAVES], most=60) if not re.search("(?<!,) and (?!then)", text)]
    assert len(texts) > 10
    for text in texts:
        verbs = [re.findall("walk|sit|wav", part) for part in apart(text)]
        assert verbs == [["walk"], ["sit"], ["wav"]], text
        assert all(re.match(r"(a person|someone|the person) \w+s .*\.$", f"{part[:-1]} .") for part in apart(text))


@pytest.mark.parametrize(
    ("says", "parts"),
    [
        ("a person walks forward, then waves.", ("a person walks forward.", "a person waves.")),
        ("after walking a bit, she stops and waves", ("she is walking a bit.", "she stops.", "she waves.")),
        ("someone walks ahead and sits down.", ("someone walks ahead.", "someone sits down.")),
        ("walk to the box and pick it up", ("walk to the box.", "pick it up.")),
        ("a person steps left, then turns around", ("a person steps left.", "a person turns around.")),
        ("he waves before sitting down.", ("he waves.", "he is sitting down.")),
        ("walk to the armchair, sit down, wave", ("walk to the armchair.", "sit down.", "wave.")),
        ("a person rises, then slows down and stops", ("a person rises.", "a person slows down.", "a person stops.")),
        *((text, (text,)) for text in (
            "a person crouches and walks.", "a person walks forward and turns left.", "walking, slow, tired",
            "a person walks in a circle, arms wide.", "a person walks and then",
            "a person walks with hands, arms and legs stiff", "then", "", "a dance, then",
        )),
    ],
)  # fmt: skip
def test_what_may_be_done_at_once_stays_together(says: str, parts: tuple[str, ...]) -> None:
    assert apart(says) == parts
