"""Random scripts: kinds come equally often, what is drawn can be planned, and every action is looked at in its time."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from torch import Tensor

from scenectl.bench.control import actions as bench
from scenectl.bench.control.actions import _criteria, _Looked, _summary, bench_actions, on_standing_legs
from scenectl.bench.control.scripts import DRAWS, SENTENCES, WAVES, Drawn, Room, Scripts, asked, reason
from scenectl.bench.engine import Engine
from scenectl.bench.models.sentences import Seen
from scenectl.evaluation.kinds import ACTS, KindClassifier, load_classifier
from scenectl.generators.spec import Spec
from scenectl.pipeline.results import Result
from scenectl.pipeline.run import score
from scenectl.tasks.actions import Act, action, actions, forget
from scenectl.tasks.schema import Start
from scenectl.tasks.setup import Setup
from scenectl.tasks.task import Task
from scenes.errors import UserError
from scenes.motion.headings import turned
from scenes.motion.motion import Motion
from tests.scenectl.tiny import TinyGenerator, statue

KINDS = sorted({kind for kinds in (*WAVES.values(), *SENTENCES.values()) for kind in kinds})
SPEC = Spec(20.0, 0.5, 120.0, 9.8, frozenset({"sentences"}))


class Several(TinyGenerator):
    """Takes several sentences."""

    spec = SPEC


class Says(KindClassifier):
    """Takes everything for one kind."""

    def __init__(self, kind: str) -> None:
        super().__init__(KINDS, 8, 1)
        self.kind = kind

    def predict(self, motions: Sequence[Tensor]) -> list[str]:
        return [self.kind] * len(motions)


def box(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[[x[0], y[0], z[0]], [x[1], y[1], z[1]]])


FURNITURE = {
    "floor": box((-2.5, 2.5), (-0.1, 0.0), (-2.5, 2.5)),
    "chair": box((1.5, 2.0), (0.05, 0.45), (-0.3, 0.3)),
    "back": box((2.0, 2.1), (0.05, 0.95), (-0.3, 0.3)),
    "table": box((-2.0, -1.2), (0.05, 0.75), (1.2, 2.0)),
}


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A floor with a chair and a table."""
    scene = trimesh.Scene()
    for name, mesh in FURNITURE.items():
        scene.add_geometry(mesh, name, name)
    path = tmp_path_factory.mktemp("scenes") / "home.glb"
    scene.export(path)
    return path


@pytest.fixture(scope="module")
def room(file: Path) -> Room:
    return Room.of(str(file), SPEC, KINDS)


@pytest.fixture(scope="module")
def many(room: Room) -> tuple[Scripts, list[Drawn]]:
    return drawn(room, 14)


def drawn(room: Room, count: int, seed: int = 0) -> tuple[Scripts, list[Drawn]]:
    drawer = Scripts(np.random.default_rng(seed), SPEC)
    return drawer, [drawer.draw(room, i) for i in range(count)]


def planned(room: Room, *tables: dict[str, Any]) -> Drawn:
    task = Task(actions=tables, scene=room.scene, start=Start(position=(0.0, -1.0), heading=0.0))
    return Drawn(room, tables, task, task.build(0, scene=room.scene, spec=SPEC))


def stood(task: Task, setup: Setup) -> Result:
    """What somebody comes to who stands at the start all the time."""
    frames = round(setup.seconds * SPEC.fps)
    motion = Motion(setup.start.apply(statue()).expand(frames, -1, -1), fps=SPEC.fps)
    return replace(score(motion, task, setup=setup), report={"timing": {"generate_s": 1.0}})


def test_kinds_come_equally_often(many: tuple[Scripts, list[Drawn]]) -> None:
    drawer, made = many
    kinds = [kind for one in made for kind in one.kinds]
    assert {kind: kinds.count(kind) for kind in DRAWS} == dict(drawer.counts)
    counts = dict(drawer.counts)
    carried = counts.pop("carry")  # by those alone who hold something
    assert set(drawer.counts) == set(DRAWS) and carried > 0 and np.ptp(list(counts.values())) <= 2, counts
    assert {len(one.tables) for one in made} == {2, 3, 4, 5}


def test_a_seed_decides_all_scripts(room: Room) -> None:
    one, again, other = (
        [(s.tables, s.task.start) for s in drawn(room, 2, seed)[1]] for seed in (5, 5, 6)
    )  # fmt: skip
    assert one == again and one != other


def test_scripts_are_tables_that_can_be_planned(many: tuple[Scripts, list[Drawn]]) -> None:
    for one in many[1][:3]:
        task = Task(actions=json.loads(json.dumps(one.tables)), scene=one.room.scene, start=one.task.start)
        assert task.build(scene=one.room.scene, spec=SPEC).seconds == one.setup.seconds


def test_who_sits_does_what_one_can_do_on_a_seat_and_gets_up(many: tuple[Scripts, list[Drawn]]) -> None:
    seated = set()
    for one in many[1]:
        script = one.setup.script
        assert script is not None
        for part in script.stretches:
            assert part.entry.spec.posture in (None, part.before.posture)
            seated |= {part.entry.spec.name} if part.before.posture == "sitting" else set()
        last = script.stretches[-1].act.then
        assert last.posture == "standing" and not last.holds
    assert {"stand_up"} < seated  # something is done on the seat, too


def test_parameters_are_what_they_are_said_to_be(room: Room, many: tuple[Scripts, list[Drawn]]) -> None:
    for part in (part for one in many[1] for part in one.setup.script.stretches):  # type: ignore[union-attr]
        given, (x, y, z) = part.entry.parameters, part.before.place
        if part.entry.spec.name == "walk":
            assert 1.0 <= np.hypot(given["to"].x - x, given["to"].z - z) <= 4.001
        elif part.entry.spec.name == "turn":
            assert np.radians(29.9) <= abs(np.angle(np.exp(1j * (given["heading"] - part.before.heading)))) <= np.pi
        elif part.entry.spec.name == "sit":
            assert given["on"] == "chair"  # the table is too high, and the floor no seat
        elif part.entry.spec.name == "reach":
            to = given["to"]
            assert 0.8 <= to.y - y <= 1.5
            aside = part.before.towards(to.x, to.z) - part.before.heading
            assert abs(np.angle(np.exp(1j * aside))) <= np.radians(45.5)
            assert float(room.scene.distance(torch.tensor([[*to]]), torch.zeros(1))) > 0.1


def test_what_the_planner_refuses_is_counted_and_something_else_is_drawn(
    room: Room, monkeypatch: pytest.MonkeyPatch
) -> None:
    places = iter(np.linspace(20, 40, 999))
    monkeypatch.setitem(DRAWS, "walk", lambda *_: {"to": [float(next(places)), 0.0]})
    drawer, made = drawn(room, 3)
    assert all("walk" not in one.kinds for one in made)
    ((why, count),) = drawer.rejected.items()
    assert count >= 2 and why.startswith("walk: path goal … is not free") and not re.search(r"\d", why)
    assert drawer.left_out()["walk"] == "no scene has what it takes"


def test_a_scene_in_which_nothing_can_be_done_is_said(room: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    for kind in DRAWS:
        monkeypatch.setitem(DRAWS, kind, lambda *_: None)
    with pytest.raises(UserError, match="in scene 'home' no script of 2 to 5 actions was found"):
        drawn(room, 1)


def test_actions_without_parameters_are_left_out_and_said(room: Room) -> None:
    @action()
    def clap(world: Any, state: Any) -> Act:
        """Clap."""
        return Act("a person claps.", 1.0, state)

    try:
        drawer, made = drawn(room, 2)
        assert all("clap" not in one.kinds for one in made)
        assert drawer.left_out()["clap"] == "the bench has no parameters for it"
    finally:
        forget("clap")


def test_seats_of_files_without_names_are_places(tmp_path: Path) -> None:
    trimesh.util.concatenate(list(FURNITURE.values())).export(tmp_path / "scan.ply")
    seats = Room.of(str(tmp_path / "scan.ply"), SPEC, KINDS).seats
    assert seats and all(not isinstance(seat, str) and seat[0] > 1.4 and seat[1] == 0.45 for seat in seats)


def test_reasons_are_the_same_whatever_the_numbers() -> None:
    told = {
        reason("sit", UserError(f"action {n} ('sit'): nobody can sit on 'a {n}' at [1.{n}, 2] or {n}.5 m; try {n}"))
        for n in range(3)
    }
    assert told == {"sit: nobody can sit on … at … or … m"}


def test_the_classifier_that_ships_knows_all_that_is_asked() -> None:
    assert set(KINDS) <= set(load_classifier(file=ACTS).kinds)
    for posture in ("a person bows.", "a person sits and raises the left hand."):
        assert asked({"do": "act", "prompt": posture, "seconds": 3.0})
    assert asked({"do": "walk", "to": [0, 1]}) is None


def test_what_no_classifier_knows_is_not_asked(file: Path) -> None:
    deaf = Room.of(str(file), SPEC, ["bandai: bow", "bandai: wave-both-hands"])
    assert deaf.sentences == ("a person bows.",) and deaf.hands == ("both",)
    none = Room.of(str(file), SPEC, [])
    assert set(Scripts(np.random.default_rng(0), SPEC).left_out()) == {spec.name for spec in actions()}
    assert not {"wave", "act"} & {kind for one in drawn(none, 3)[1] for kind in one.kinds}


WAVE = ({"do": "stand", "seconds": 3.0}, {"do": "wave", "hand": "right"}, {"do": "stand", "seconds": 3.0})


@pytest.mark.parametrize(
    ("kind", "begin", "found", "timely"),
    [
        ("bandai: wave-right-hand", 3.2, True, True),
        ("bandai: wave-right-hand", 2.8, True, True),  # but for a seam
        ("bandai: wave-right-hand", 0.5, True, False),
        ("bandai: wave-left-hand", 3.2, False, False),
        ("bandai: bow", 3.2, False, False),
    ],
)
def test_a_wave_is_done_where_it_is_found_and_in_order_in_its_time(
    room: Room, kind: str, begin: float, found: bool, timely: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "look", lambda *_: [Seen(begin, begin + 2.0, kind)])
    one = planned(room, *WAVE)
    made = stood(one.task, one.setup)
    first, wave, _ = _Looked.at(made, one, Says(kind)).rows()
    assert first["done"] and first["in_order"] and first["by_chance"] is None
    assert (wave["done"], wave["in_order"]) == (found, timely)
    assert wave["missed"] == ([] if found else ["not recognised"]) and wave["success"] <= (found and timely)
    assert wave["by_chance"] == pytest.approx(0.1 if kind == "bandai: bow" else 0.0)


def test_a_trunk_on_standing_legs_is_that_of_who_sits() -> None:
    upright = statue()
    sits = upright.clone()
    legs = [1, 2, 4, 5, 7, 8, 10, 11]
    sits[legs[2:], 1] += 0.4  # thighs are level
    sits[legs[2:], 2] += 0.4
    sits += torch.tensor([2.0, -0.3, 1.0])
    for angle in (0.0, 2.0):
        seen = on_standing_legs(Motion(turned(sits, torch.tensor(angle))[None], fps=20.0))[0]
        wanted = turned(upright + torch.tensor([2.0, 0.0, 1.0]), torch.tensor(angle))
        assert torch.allclose(seen, wanted, atol=1e-5)


def test_who_waves_on_a_seat_is_seen_on_standing_legs(room: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = list[float]()
    monkeypatch.setattr(bench, "joints_to_features", lambda joints: seen.append(float(joints[..., 0, 1].max())))
    monkeypatch.setattr(bench, "look", lambda *_: [])
    one = planned(room, {"do": "sit", "on": "chair"}, {"do": "wave", "hand": "left"}, {"do": "stand_up"})
    made = stood(one.task, one.setup)
    made = replace(made, motion=replace(made.motion, joints=made.motion.joints - torch.tensor([0.0, 0.4, 0.0])))
    assert not _Looked.at(made, one, Says(KINDS[0])).rows()[1]["done"]
    assert seen == [pytest.approx(float(statue()[0, 1]), abs=1e-4)]  # as high as who stands, and not as who sits


def test_faults_are_those_of_the_action_in_whose_time_they_are(room: Room) -> None:
    one = planned(room, *WAVE)
    made = stood(one.task, one.setup)
    jumps = made.motion.joints.clone()
    jumps[:, 90:, :, 0] += 0.5  # in the middle of the wave
    broken = replace(made, motion=replace(made.motion, joints=jumps))
    whole, cut = (_Looked.at(each, one, Says(KINDS[0])).rows() for each in (made, broken))
    more = [set(after["checks"]) - set(before["checks"]) for before, after in zip(whole, cut, strict=True)]
    assert more[1] and not more[0] and not more[2]


def test_goals_that_are_missed_are_named_by_their_action(room: Room) -> None:
    one = planned(room, {"do": "stand"}, {"do": "walk", "to": [0.0, 1.5]}, {"do": "stand"})
    before, walk, after = _Looked.at(stood(one.task, one.setup), one, Says(KINDS[0])).rows()
    assert before["done"] and before["in_order"] and not before["missed"]
    assert not walk["done"] and not walk["success"] and "walk: arrive" in walk["missed"]
    assert after["missed"] == ["stays"]  # where the walk would have ended


def row(script: int, kind: str, success: bool, **more: Any) -> dict[str, Any]:
    every = {"done": success, "believable": success, "in_order": success, "missed": [], "checks": [], "by_chance": None}
    whole = {"sample_good": success, "seam_ratio": None, "seconds": 1.0 + script}
    return {"script": script, "kind": kind, "success": success, **every, **whole, **more}


def test_a_script_succeeds_when_all_of_it_does() -> None:
    rows = [row(0, "walk", True), row(0, "wave", False, missed=["not recognised"]), row(1, "walk", True)]
    found = _summary(rows)
    assert found["script_success_rate"] == 0.5 and found["action_success_rate"] == {"walk": 1.0, "wave": 0.0}
    assert found["faults"]["wave"] == {"not recognised": 1} and found["median_seconds"] == 1.5
    met = {line["criterion"].split("'")[1]: line["met"] for line in _criteria(found)[:-1]}
    assert met["walk"] and not met["wave"] and not met["duck"]  # what was not drawn is not met


def test_the_bench_keeps_rows_for_every_action_and_draws_what_fails(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "run", lambda task, *_, setup, **__: stood(task, setup))
    drawn = list[Path]()
    engine = Engine(file=tmp_path / "found.json")
    result = bench_actions(
        Several(), Says("hop"), [file], 3, 0, 1, (tmp_path / "failed", lambda made, png: drawn.append(png)), engine
    )
    json.dumps(result)
    rows, summary = result["rows"], result["summary"]
    assert summary["scripts"] == 3 and sum(summary["actions"].values()) == len(rows)
    failing = sorted({r["script"] for r in rows if not r["success"]})
    assert [png.name for png in drawn] == [f"script_{i:03d}.png" for i in failing] and failing
    assert {r["scene"] for r in rows} == {"home"} and summary["not_drawn"]["lean"]
    monkeypatch.setattr(bench, "run", None)  # rows that were kept are not measured again
    assert bench_actions(Several(), Says("hop"), [file], 3, 0, 1, None, engine) == result


def test_scripts_are_run(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for kind in set(DRAWS) - {"stand", "wave"}:
        monkeypatch.delitem(DRAWS, kind)
    result = bench_actions(Several(), Says("bandai: wave-left-hand"), [file], 1, samples=1)
    assert {r["kind"] for r in result["rows"]} == {"stand", "wave"}
    assert all(r["seconds"] > 0 and r["verdict"] for r in result["rows"])
    assert all(r["by_chance"] is not None and r["seen"] for r in result["rows"] if r["kind"] == "wave")


def test_a_script_of_which_nothing_is_made_fails(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> Any:
        raise UserError("the motion is too short")

    monkeypatch.setattr(bench, "run", refuse)
    result = bench_actions(Several(), Says("hop"), [file], 1, samples=1)
    assert not any(row["success"] for row in result["rows"]) and result["summary"]["rejected"] == {}
    assert {row["verdict"] for row in result["rows"]} == {"the motion is too short"}
    assert result["summary"]["script_success_rate"] == 0.0 and result["summary"]["median_seconds"] is None


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--no-bundled",), "name one with --scene"),
        (("--scene", "nowhere"), "'nowhere' is neither"),
        (("--seed", -1), "give a seed from 0"),
        (("--samples", 257), "and 1 to 256"),
    ],
)
def test_what_cannot_be_is_answered_in_a_sentence(
    given: tuple[Any, ...], said: str, scenectl: Callable[..., Any], tiny_generator: None
) -> None:
    answer = scenectl("bench", "actions", "--scripts", 6, *given)
    assert answer.status == 2 and said in " ".join(answer.err.split()) and "Traceback" not in answer.err


def test_parameters_are_drawn_of_actions_that_exist() -> None:
    assert set(DRAWS) <= {spec.name for spec in actions()}
