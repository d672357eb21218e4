"""Several things said in one sentence."""

from __future__ import annotations

from scenectl.data.sentences import in_one

WALKS = ("a person walks forward.", "someone walks ahead.")
SITS = ("a person sits down on a chair.",)
WAVES = ("the person waves.", "a person waves with the right hand")


def test_all_is_said_in_order_with_one_subject_and_one_full_stop() -> None:
    for text in in_one([WALKS, SITS, WAVES], most=30):
        assert text.startswith(("a person walks forward", "someone walks ahead"))
        assert text.index("walks") < text.index("sits down on a chair") < text.index("waves")
        assert text.count(".") == 1 and text.endswith(".")
        assert sum(text.count(subject) for subject in ("a person", "someone", "the person")) == 1


def test_wordings_vary_and_are_the_same_again() -> None:
    made = in_one([WALKS, SITS, WAVES], most=30)
    assert len(made) == len(set(made)) > 8
    assert made == in_one([WALKS, SITS, WAVES], most=30)


def test_one_thing_is_said_as_it_is() -> None:
    assert in_one([SITS]) == SITS
