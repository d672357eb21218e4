"""The adaptive schedule (Eq. 7): how many tokens a scale has for a motion of any length."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import given, strategies as st

from scenectl.generators.mscot.config import BASE_SCALES
from scenectl.generators.mscot.schedule import DOWNSAMPLING, scale_lengths, tokens_for
from scenes.errors import UserError

bases = st.one_of(
    st.just(BASE_SCALES), st.lists(st.integers(1, 40), min_size=1, max_size=12).map(lambda x: tuple(sorted(x)))
)


@given(bases, st.integers(9, 200))
def test_the_last_scale_is_the_motion_and_no_scale_is_shorter_than_the_one_before(
    base: tuple[int, ...], finest: int
) -> None:
    lengths = scale_lengths(base, finest)
    assert len(lengths) == len(base) and lengths[-1] == finest
    assert all(a <= b for a, b in zip(lengths[:-1], lengths[1:], strict=True)) and lengths[0] >= 1


@given(st.integers(9, 200))
def test_scales_grow_with_rho_as_the_paper_rounds_them(finest: int) -> None:
    rho = Fraction(finest, BASE_SCALES[-1])
    assert scale_lengths(BASE_SCALES, finest) == tuple(math.ceil(rho * length) for length in BASE_SCALES)


def test_the_base_schedule_belongs_to_sixty_four_frames() -> None:
    assert scale_lengths(BASE_SCALES, tokens_for(64)) == BASE_SCALES
    assert scale_lengths(BASE_SCALES, 2 * tokens_for(64)) == tuple(2 * length for length in BASE_SCALES)


@given(st.integers(1, 5000))
def test_tokens_cover_the_frames_and_no_token_is_idle(frames: int) -> None:
    tokens = tokens_for(frames)
    assert 0 <= tokens * DOWNSAMPLING - frames < DOWNSAMPLING


@pytest.mark.parametrize("finest", [0, -3])
def test_no_token_at_all_is_refused_in_a_sentence(finest: int) -> None:
    with pytest.raises(UserError, match="at least one token"):
        scale_lengths(BASE_SCALES, finest)
