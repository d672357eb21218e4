"""What is told about task files is what reads them: every key, with a type, a default and a sentence."""

from __future__ import annotations

import pytest

from objectives.registry import TERM_KEYS
from scenectl.generators.mscot.settings import Sampling
from scenectl.tasks.keys import table, tables
from scenectl.tasks.schema import SceneSpec, TaskTable, known_keys
from scenectl.tasks.walk import Walk
from scenes.errors import UserError

TABLES = tables()


def test_every_table_that_is_read_is_told() -> None:
    assert {"", "scene", "scene.objects", "start", "walk", "generator", "solver", "guidance", "goal"} <= TABLES.keys()
    for name, model in (("", TaskTable), ("walk", Walk), ("scene", SceneSpec)):
        assert [key.name for key in TABLES[name].keys] == [
            info.alias or key for key, info in model.model_fields.items() if (info.alias or key) in known_keys(model)
        ]
    assert "folder" not in {key.name for key in TABLES[""].keys}
    assert {key.name for key in TABLES["goal"].keys} == set(TERM_KEYS)
    assert {key.name for key in TABLES["generator"].keys} > set(Sampling.model_fields)


@pytest.mark.parametrize("name", TABLES)
def test_every_key_has_a_type_and_a_sentence(name: str) -> None:
    for key in TABLES[name].keys:
        assert key.meaning and "`" not in key.meaning, key
        assert key.type and not any(word in key.type for word in ("dict", "Any", "None", "<", "Spec", "tuple")), key
    assert TABLES[name].summary


def test_types_bounds_units_and_defaults() -> None:
    walk = {key.name: key for key in TABLES["walk"].keys}
    assert (walk["radius"].type, walk["radius"].default, walk["radius"].unit) == ("a number over 0.05 to 1", "", "m")
    assert (walk["to"].default, walk["to"].unit, walk["arrive"].unit, walk["arrive"].default) == (
        "required",
        "m",
        "s",
        "",
    )
    objects = {key.name: key for key in TABLES["scene.objects"].keys}
    assert objects["headings"].unit == "rad" and objects["unit"].type == "'m', 'cm', 'mm', 'in' or 'ft'"
    assert {key.name: key.type for key in TABLES[""].keys}["goal"] == "[[goal]] tables"
    assert {key.name: key.type for key in TABLES["goal"].keys}["at"] == "a number or a list of numbers"


def test_unknown_tables_are_told() -> None:
    assert table("[walk]") == table("walk") == TABLES["walk"]
    for name in ("wlak", ""):
        with pytest.raises(UserError, match="a task has no table"):
            table(name)
