"""What pydantic finds wrong, in words: where, what, and the nearest known key."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import pytest
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from scenes.validation import sentence


class Spot(NamedTuple):
    x: float
    z: float


class Table(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Disc(Table):
    kind: Literal["disc"] = "disc"
    radius: Annotated[float, Field(gt=0)]


class Bar(Table):
    kind: Literal["bar"] = "bar"
    ends: tuple[tuple[float, float], tuple[float, float]]

    @model_validator(mode="after")
    def _long(self) -> Bar:
        if self.ends[0] == self.ends[1]:
            raise ValueError("a bar needs two ends")
        return self


class Room(Table):
    name: str = ""
    things: Annotated[tuple[Annotated[Disc | Bar, Field(discriminator="kind")], ...], Field(alias="thing")] = ()
    place: tuple[float, float] | Disc | None = None


class House(Table):
    rooms: list[Room] = []
    size: Literal["small", "large"] = "small"
    file: Path | None = None
    open: bool = True
    count: int = 0
    pair: tuple[float, float] = (0.0, 0.0)
    spot: Spot | None = None
    folder: str = ""


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"sise": "small"}, "unknown key 'sise'; did you mean 'size'?"),
        ({"zzz": 1}, "unknown key 'zzz'; known are count, file, open, pair, rooms, size, spot"),
        ({"size": "huge"}, "'size' is 'huge': input should be 'small' or 'large'"),
        ({"rooms": [{}, {"nam": "x"}]}, "[rooms 2]: unknown key 'nam'; did you mean 'name'?"),
        ({"rooms": [{"things": []}]}, "[rooms 1]: unknown key 'things'; did you mean 'thing'?"),
        ({"rooms": [{"thing": [{"kind": "disc"}]}]}, "'radius' is missing in [rooms 1.thing 1]"),
        (
            {"rooms": [{"thing": [{"radius": 1}]}]},
            "[rooms 1.thing 1]: 'kind' is missing; known are bar, disc",
        ),
        (
            {"rooms": [{"thing": [{"kind": "disk"}]}]},
            "[rooms 1.thing 1]: 'kind' is 'disk'; did you mean 'disc'?",
        ),
        (
            {"rooms": [{"thing": [{"kind": "bar", "end": 1}]}]},
            "[rooms 1.thing 1]: unknown key 'end'; did you mean 'ends'?",
        ),
        (
            {"rooms": [{"thing": [{"kind": "disc", "radius": -1}]}]},
            "'rooms 1.thing 1.radius' is -1: input should be greater than 0",
        ),
        ({"rooms": [{"thing": [{"kind": "bar", "ends": [[0, 0], [0, 0]]}]}]}, "a bar needs two ends"),
        (
            {"rooms": [{"thing": [{"kind": "bar", "ends": [[0, 0], [1]]}]}]},
            "'rooms 1.thing 1.ends' is [[0, 0], [1]]: a number is missing",
        ),
        (
            {"rooms": [{"place": {"kind": "disc", "radios": 1}}]},
            "[rooms 1.place]: unknown key 'radios'; did you mean 'radius'?",
        ),
        ({"rooms": [5]}, "'rooms 1' is 5: input should be a table"),
        ({"rooms": [{"name": 5}]}, "'rooms 1.name' is 5: input should be text"),
        (
            {"rooms": [{"thing": [{"kind": "disc", "radius": "x"}]}]},
            "'rooms 1.thing 1.radius' is 'x': input should be a number",
        ),
        ({"file": 3}, "'file' is 3: input should be a path, as text"),
        ({"open": "maybe"}, "'open' is 'maybe': input should be true or false"),
        ({"count": 1.5}, "'count' is 1.5: input should be a whole number"),
        ({"pair": [1, 2, 3]}, "'pair' is [1, 2, 3]: it should have at most 2 entries, not 3"),
        ({"spot": 5}, "'spot' is 5: input should be a list of numbers"),
        ({"size": "x" * 3000}, f"'size' is 'xxx{'x' * 73}...: input should be 'small' or 'large'"),
        ({"x" * 3000: 1}, f"unknown key '{'x' * 77}...'; known are"),
        (
            {"rooms": [{"thing": [{"kind": "x" * 3000}]}]},
            f"[rooms 1.thing 1]: 'kind' is '{'x' * 77}...'; known are bar",
        ),
        ({"rooms": 3}, "'rooms' is 3: input should be a list"),
    ],
)
def test_faults_of_nested_tables(data: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError) as caught:
        House.model_validate(data)
    assert sentence(caught.value, data, House, hidden=("folder",)).startswith(said)


@pytest.mark.parametrize(
    ("hint", "data", "said"),
    [
        (Annotated[float, Field(gt=0)], -1.0, "input should be greater than 0, not -1.0"),
        (Annotated[Disc | Bar, Field(discriminator="kind")], {"kind": "baz"}, "'kind' is 'baz'; did you mean 'bar'?"),
        (tuple[float, float] | Disc, {"radios": 1.0}, "unknown key 'radios'; did you mean 'radius'?"),
    ],
)
def test_faults_of_values_outside_tables(hint: Any, data: Any, said: str) -> None:
    with pytest.raises(ValidationError) as caught:
        TypeAdapter(hint).validate_python(data)
    assert sentence(caught.value, data, hint) == said
