"""JSON Schema of tasks and reports: what it knows is what is read."""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

import scenectl as sc
from objectives import forget, goal, goals
from objectives.registry import TERM_KEYS
from scenectl.generators.registry import names
from scenectl.tasks.json_schema import task_schema
from scenes.errors import UserError
from scenes.mesh.primitives import PRIMITIVES

ROOT = Path(__file__).resolve().parents[3]
EXAMPLES = sorted((ROOT / "examples" / "tasks").glob("*.toml"))
README = (ROOT / "README.md").read_text(encoding="utf-8")
SNIPPETS = [tomllib.loads(text) for text in re.findall(r"```toml\n(.*?)```", README, re.DOTALL)]
HEAD = {"prompt": "a person walks", "seconds": 3.0}


@pytest.fixture(scope="module")
def schema() -> Draft202012Validator:
    found = json.loads(json.dumps(task_schema(), allow_nan=False))
    Draft202012Validator.check_schema(found)
    return Draft202012Validator(found)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_every_example_is_valid(path: Path, schema: Draft202012Validator) -> None:
    schema.validate(tomllib.loads(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("table", SNIPPETS, ids=range(len(SNIPPETS)))
def test_every_snippet_of_the_readme_is_valid(table: dict[str, Any], schema: Draft202012Validator) -> None:
    schema.validate(table if "prompt" in table else HEAD | table)


def tables(value: Any, way: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Every way to a table inside nested tables and lists."""
    if isinstance(value, dict):
        yield way
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from tables(item, (*way, key))


def at(value: Any, way: tuple[str | int, ...]) -> Any:
    for key in way:
        value = value[key]
    return value


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_unknown_key_in_any_table_is_refused_as_the_loader_refuses_it(
    path: Path, schema: Draft202012Validator
) -> None:
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    for way in tables(table):
        wrong = copy.deepcopy(table)
        at(wrong, way)["x_unknown"] = 1
        assert not schema.is_valid(wrong), way
        with pytest.raises(UserError, match="x_unknown"):
            sc.Task(**wrong, folder=path.parent).build()


GOOD: dict[str, dict[str, Any]] = {
    "sentences with their times": {"prompt": [{"text": "a", "end": 2.0}, {"text": "b", "begin": 2.5}]},
    "a length that the last sentence states": {"prompt": [{"text": "a", "end": 2.0}], "seconds": None},
    "a scene by name": {"scene": "living_room"},
    "a scene by file": {"scene": "kitchen.glb"},
    "a start that is sampled": {"start": "sample"},
    "a start as a place": {"start": [0.0, 1.0]},
    "a start as a place in space": {"start": [0, 1.0, 0.5]},
    "a start to be found": {"start": {"position": [0.0, 0.0], "free": True}},
    "free space from a point": {"scene": {"file": "x.ply", "free_space": [0.0, 1.0, 0.0]}},
    "settings of a generator": {"generator": {"cfg": 3.0, "weights": "permissive", "threads": 2}},
    "a generator by name": {"generator": {"name": "mscot", "top_p": 0.5}},
    "a walk without a length": {"seconds": None, "walk": {"to": [0.0, 1.0]}},
    "one time": {"goal": [{"use": "head_height", "height": 1.2, "at": 1.0}]},
    "several times": {"goal": [{"use": "head_height", "height": [1.2, 1.1], "at": [1, 2.0], "weights": [1, 2]}]},
    "a joint": {"goal": [{"use": "joint_target", "joint": "head", "position": [0, 1]}]},
    "a list of joints": {"goal": [{"use": "joint_target", "joint": ["head"], "position": [0, 1]}]},
    "a track": {"goal": [{"use": "joint_target", "track": {
        "kind": "arc", "center": [0, 0.9, 2], "radius": 1.5, "angles": [0, 1.57], "times": [1, 2]}}]},
    "a track in place": {"goal": [{"use": "joint_target", "track": {"kind": "array", "positions": [[0, 1, 0]] * 60}}]},
    "a moment": {"goal": [{"use": "joint_target", "position": [0, 1], "sometime": [1, 2], "kernel": "huber"}]},
    "a script": {
        "prompt": None,
        "seconds": None,
        "action": [
            {"do": "walk", "to": [0.0, 2.0], "via": [[1.0, 1.0]], "how": "backwards"},
            {"do": "sit", "on": "chair", "name": "rest", "goal": [{"use": "face", "heading": 0.0, "at": 1.0}]},
        ],
    },
    "a scene that is not avoided": {"avoid": False},
    "what may touch": {"avoid": {"exempt": ["right_wrist"], "margin": 0.01}},
    "every shape": {"scene": {"primitives": [
        {"shape": "box", "center": [0, 1, 9], "size": [1, 1, 1], "yaw": 1},
        {"shape": "sphere", "center": [0, 1, 9], "radius": 0.3, "motion": {"times": [0], "positions": [[0, 0, 9]]}},
        {"shape": "capsule", "a": [0, 1, 9], "b": [0, 2, 9], "radius": 0.3},
        {"shape": "cylinder", "center": [0, 1, 9], "radius": 0.3, "height": 1.0},
        {"shape": "plane", "point": [0, 0, 0]},
    ]}},
}  # fmt: skip
"""Tables beside a prompt and 3 seconds that the loader reads."""
NO_FILE = ("a scene by file", "free space from a point")
BAD: dict[str, dict[str, Any]] = {
    "no length": {"seconds": None},
    "no prompt": {"prompt": None},
    "no sentences": {"prompt": []},
    "a sentence without text": {"prompt": [{"begin": 1.0}]},
    "a sentence that begins before": {"prompt": [{"text": "a", "begin": -1.0}]},
    "a sentence with another key": {"prompt": [{"text": "a", "start": 1.0}]},
    "an empty prompt": {"prompt": ""},
    "a name for Python": {"folder": "."},
    "goals by their name in Python": {"goals": []},
    "a start of three words": {"start": "somewhere"},
    "a start of one number": {"start": [0.0]},
    "an unknown goal": {"goal": [{"use": "joint_tagret"}]},
    "a goal without use": {"goal": [{"joint": "head"}]},
    "a goal that is no table": {"goal": [1]},
    "another goal's parameter": {"goal": [{"use": "foot_contact", "margin": 0.1}]},
    "a parameter that is missing": {"goal": [{"use": "height_limit"}]},
    "a parameter in words": {"goal": [{"use": "head_height", "height": "tall"}]},
    "a negative weight": {"goal": [{"use": "foot_contact", "weight": -1.0}]},
    "an unknown kernel": {"goal": [{"use": "foot_contact", "kernel": "cubic"}]},
    "an unknown shape": {"scene": {"primitives": [{"shape": "boks"}]}},
    "a box without a size": {"scene": {"primitives": [{"shape": "box", "center": [0, 1, 2]}]}},
    "a center of two": {"scene": {"primitives": [{"shape": "sphere", "center": [0, 1], "radius": 1.0}]}},
    "a motion with more": {"scene": {"primitives": [
        {"shape": "sphere", "center": [0, 1, 2], "radius": 1, "motion": {"times": [], "positions": [], "x": 1}}
    ]}},
    "an object without times": {"scene": {"objects": [{"mesh": "x.glb", "positions": [[0, 0, 0]]}]}},
    "an unknown generator": {"generator": {"name": "mscott"}},
    "another key of a generator": {"generator": {"sway": 1.0}},
    "a script with a sentence": {"seconds": None, "action": [{"do": "stand"}]},
    "an action that is none": {"prompt": None, "seconds": None, "action": [{"do": "fly"}]},
    "an action without what it needs": {"prompt": None, "seconds": None, "action": [{"do": "walk"}]},
    "what is avoided in words": {"avoid": "walls"},
    "another goal's key to avoid by": {"avoid": {"half": 1.0}, "scene": "corridor"},
    "no threads": {"generator": {"threads": 0}},
    "too many samples": {"samples": 1000},
    "half a sample": {"samples": 1.5},
    "a negative seed": {"seed": -1},
}  # fmt: skip


def stated(more: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in {**HEAD, **more}.items() if value is not None}


@pytest.mark.parametrize("what", GOOD)
def test_every_way_of_writing_is_known(what: str, schema: Draft202012Validator) -> None:
    schema.validate(stated(GOOD[what]))
    if what not in NO_FILE:
        sc.Task(**stated(GOOD[what]))


@pytest.mark.parametrize("what", BAD)
def test_what_the_loader_refuses_is_not_valid(what: str, schema: Draft202012Validator) -> None:
    assert not schema.is_valid(stated(BAD[what]))
    if what not in ("a name for Python", "goals by their name in Python", "no prompt"):  # what only files do not know
        with pytest.raises(UserError):
            sc.Task(**stated(BAD[what])).build()


def test_every_goal_shape_and_generator_is_described(schema: Draft202012Validator) -> None:
    found = schema.schema["$defs"]
    for spec in goals():
        table = found[spec.name]
        assert set(table["properties"]) == {*TERM_KEYS, *spec.parameters}
        assert table["description"] == spec.summary and table["additionalProperties"] is False
        for parameter in spec.parameters.values():
            if parameter.name not in TERM_KEYS:
                assert table["properties"][parameter.name]["description"] == parameter.doc
    assert set(PRIMITIVES) <= found.keys()
    assert {f"generator {name}" for name in names()} <= found.keys() or len(names()) == 1


def test_goals_of_ones_own_are_known_once_they_are_registered(schema: Draft202012Validator) -> None:
    table = HEAD | {"goal": [{"use": "stay_low_here", "limit": 1.0}]}
    assert not schema.is_valid(table)

    @goal(unit="m")
    def stay_low_here(motion: Any, context: Any, *, limit: float) -> Any:
        """Stay low."""
        return motion.joint("head")[..., 1:2] - limit

    try:
        assert Draft202012Validator(task_schema()).is_valid(table)
        assert not Draft202012Validator(task_schema()).is_valid(HEAD | {"goal": [{"use": "stay_low_here"}]})
    finally:
        forget("stay_low_here")


def test_the_command_prints_both(scenectl: Callable[..., Any], tiny_generator: None, tmp_path: Path) -> None:
    said = scenectl("schema", "task")
    assert said.status == 0 and json.loads(said.out) == json.loads(json.dumps(task_schema()))
    said = scenectl("schema", "report")
    report = Draft202012Validator(json.loads(said.out))
    Draft202012Validator.check_schema(report.schema)
    old = ROOT / "tests" / "scenectl" / "pipeline" / "format_1" / "report.json"
    report.validate(json.loads(old.read_text()))
    (tmp_path / "task.toml").write_text(
        'prompt = "x"\nseconds = 2.0\nsamples = 2\nstart = [0, 0]\n[walk]\nto = [0, 1]\n[[goal]]\nuse = "smoothness"\n'
    )
    assert scenectl("run", tmp_path / "task.toml", "-o", tmp_path, "--no-preview", "--allow-unmet").status == 0
    told = json.loads((tmp_path / "report.json").read_text())
    report.validate(told)
    assert not report.is_valid({**told, "walk": {"path": [[0, 0]], "length_m": 1.0}})
    assert (
        scenectl("score", tmp_path, tmp_path / "task.toml", "--json", tmp_path / "s.json", "--allow-unmet").status == 0
    )
    report.validate(json.loads((tmp_path / "s.json").read_text()))
    said = scenectl("schema", "tsak")
    assert said.status == 2 and "did you mean 'task'" in said.err
