"""Numbers of tables are numbers, finite, and of a size that can be meant, wherever in a table they stand."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from pydantic import Field, TypeAdapter, ValidationError

from scenes.errors import UserError, shown
from scenes.numbers import LONGEST_WHOLE, MOST, WIDEST, finite, is_number, positive, vector
from scenes.tables import Strict, Table


@dataclass
class Plain:
    x: float = 0.0
    whole: int = 0


class Inner(Table):
    x: float = 0.0


class Outer(Table):
    number: float = 0.0
    share: float = Field(default=0.5, ge=0, lt=1)
    whole: int = 0
    few: int = Field(default=1, ge=1, le=5)
    flag: bool = False
    perhaps: float | None = None
    place: tuple[float, float, float] | tuple[float, float] = (0.0, 0.0)
    many: tuple[Annotated[float, Field(gt=0)], ...] = ()
    by_name: dict[str, float] = Field(default_factory=dict)
    inner: Inner = Inner()
    several: tuple[Inner, ...] = ()
    plain: Plain | None = None
    more: tuple[Plain, ...] = ()


NO_NUMBERS = (True, "1", "nan", None, [], {}, math.nan, math.inf, -math.inf, 2 * MOST, -1e30, 1e308, 10**30, 10**400)
PLACES: dict[str, Any] = {
    "number": lambda x: x,
    "share": lambda x: x,
    "place": lambda x: [0, x, 1.5],
    "many": lambda x: [1, x],
    "by_name": lambda x: {"a": x},
    "inner": lambda x: {"x": x},
    "several": lambda x: [{"x": 1}, {"x": x}],
    "plain": lambda x: {"x": x},
    "more": lambda x: [{"x": 1}, {"x": x}],
}


@pytest.mark.parametrize("given", NO_NUMBERS, ids=shown)
@pytest.mark.parametrize("place", PLACES)
def test_what_is_no_number_is_refused_everywhere(place: str, given: Any) -> None:
    with pytest.raises(ValidationError):
        Outer.model_validate({place: PLACES[place](given)})


@pytest.mark.parametrize("given", [True, "1", 1.0, 1.5, LONGEST_WHOLE + 1, 10**400, math.nan], ids=shown)
def test_what_is_no_whole_number_is_refused(given: Any) -> None:
    for key in ("whole", "few"):
        with pytest.raises(ValidationError):
            Outer.model_validate({key: given})
    with pytest.raises(ValidationError):
        Outer.model_validate({"flag": 1})


@given(number=st.integers(-(10**9), 10**9) | st.floats(-MOST, MOST), whole=st.integers(-LONGEST_WHOLE, LONGEST_WHOLE))
def test_numbers_within_the_bounds_are_taken_as_they_are(number: float, whole: int) -> None:
    made = Outer.model_validate({"number": number, "whole": whole, "place": [number] * 3, "inner": {"x": number}})
    assert (made.number, made.whole, made.place, made.inner.x) == (number, whole, (number,) * 3, number)
    assert is_number(number) and finite(number, "x") == number and vector([number] * 3, "x") == (number,) * 3


def test_bounds_that_a_field_states_stay_and_the_schema_shows_all() -> None:
    shown = Outer.model_json_schema()["properties"]
    assert (shown["number"]["minimum"], shown["number"]["maximum"]) == (-MOST, MOST)
    assert (shown["share"]["minimum"], shown["share"]["exclusiveMaximum"]) == (0, 1) and "maximum" not in shown["share"]
    assert (shown["few"]["minimum"], shown["few"]["maximum"]) == (1, 5)


@pytest.mark.parametrize("given", NO_NUMBERS, ids=shown)
def test_any_type_is_made_strict_for_single_values(given: Any) -> None:
    values: tuple[tuple[Any, Any], ...] = (
        (float, given), (list[float], [given]), (tuple[float, float], [given, given]), (Plain, {"x": given}),
        (Annotated[float, Field(ge=0)], given), (int | Plain, {"x": given}),
        (dict[str, list[Plain]], {"a": [{"x": given}]}),
    )  # fmt: skip
    for hint, value in values:
        with pytest.raises(ValidationError):
            TypeAdapter(Annotated[hint, Strict()]).validate_python(value)


@pytest.mark.parametrize("given", [g for g in NO_NUMBERS if g is not None], ids=shown)
def test_numbers_of_python_callers_are_checked_alike(given: Any) -> None:
    for check in (finite, positive):
        with pytest.raises(UserError, match="speed is") as told:
            check(given, "speed")
        assert len(str(told.value)) < 200
    for place in ((0.0, given, 0.0), given, [given] * 3, [0.0, 1.0]):
        with pytest.raises(UserError, match="centre is"):
            vector(place, "centre")
    with pytest.raises(UserError, match="from 1e-06 to 10000"):
        positive(2 * WIDEST, "radius")


def test_numbers_of_numpy_are_numbers() -> None:
    assert vector(np.array([1, 2, 3]), "x") == (1.0, 2.0, 3.0) and finite(np.float32(0.5), "x") == 0.5
    assert not is_number(np.array([1.0])) and not is_number(np.bool_(True)) and not is_number(np.float64("nan"))
