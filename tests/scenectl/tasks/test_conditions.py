"""Goals as plain numbers: what of a task a network can take as input."""

from __future__ import annotations

import math

import pytest
import torch

from objectives import Objective, Term
from scenectl.generators.mscot.settings import SPEC
from scenectl.pipeline.generation import make
from scenectl.tasks.conditions import conditions_of
from scenectl.tasks.task import Task
from scenes.motion.motion import Pose2D
from scenes.world.scene import Scene
from tests.objectives.cases import context
from tests.scenectl.lively import Lively

WRIST = Term("joint_target", {"joint": "right_wrist", "position": [0.4, 1.2, 0.9]}, at=1.5)
FLOOR = Term("joint_target", {"joint": "pelvis", "position": [1.0, 2.0]}, at=[1.0, 2.0])
HEIGHT = Term("height_limit", {"limit": 1.2})


def test_targets_are_stated_where_and_when_they_are() -> None:
    found = conditions_of(Objective((WRIST, FLOOR, HEIGHT)), context(), Pose2D((3.0, 0.0, 1.0), 0.5), 3.0, SPEC)
    assert found.times.tolist() == [1.5, 1.0, 2.0]
    assert [SPEC.skeleton.names[joint] for joint in found.joints.tolist()] == ["right_wrist", "pelvis", "pelvis"]
    torch.testing.assert_close(found.positions, torch.tensor([[0.4, 1.2, 0.9], [1.0, 0.0, 2.0], [1.0, 0.0, 2.0]]))
    assert found.position_mask.tolist() == [[True] * 3, [True, False, True], [True, False, True]]
    assert not (found.direction_mask | found.rotation_mask | found.contact_mask).any() and not found.front_mask.any()
    signal, mask = found.position_signal(60, SPEC.fps)
    assert signal[30, SPEC.skeleton.index("right_wrist")].tolist() == pytest.approx([0.4, 1.2, 0.9])
    assert int(mask.sum()) == 3 + 2 * 2


def test_aims_are_stated_where_they_hold_for_any_body() -> None:
    goals = (
        WRIST,
        Term("face", {"heading": 0.5}, at=1.0),
        Term("face", {"part": "chest", "direction": (0.0, 3.0, 4.0), "level": False}, at=1.0),
        Term("bone_direction", {"bone": "left_wrist", "direction": (0.0, 2.0, 0.0)}, at=2.0),
        Term("joint_rotation", {"joint": "spine3", "euler": (0.0, 90.0, 0.0), "frame": "world"}, at=0.5),
        # Which way these point depends on where the body is, or how it is turned.
        Term("face", {"position": [2.0, 3.0]}, at=1.0),
        Term("bone_direction", {"bone": "head", "direction": (0.0, 0.0, 1.0), "frame": "pelvis"}, at=1.0),
        Term("bone_direction", {"bone": ["right_shoulder", "right_wrist"], "direction": (0.0, 1.0, 0.0)}, at=1.0),
        Term("joint_rotation", {"joint": "left_shoulder", "euler": (0.0, 0.0, -60.0)}, at=0.5),
        Term("face", {"heading": 0.5}, sometime=[1.0, 2.0]),
    )
    found = conditions_of(Objective(goals), context(), Pose2D((3.0, 0.0, 1.0), 0.5), 3.0, SPEC)
    names = [SPEC.skeleton.names[joint] for joint in found.joints.tolist()]
    stated = {
        what: [names[k] for k in range(len(found)) if getattr(found, f"{what}_mask")[k].any()]
        for what in ("position", "front", "direction", "rotation")
    }
    assert stated == {
        "position": ["right_wrist"],
        "front": ["pelvis", "spine3"],
        "direction": ["left_wrist"],
        "rotation": ["spine3"],
    }
    fronts = found.fronts[found.front_mask.any(-1)]
    torch.testing.assert_close(fronts[1], torch.tensor([0.0, 0.6, 0.8]))
    assert fronts[0].tolist() == pytest.approx([math.sin(0.5), 0.0, math.cos(0.5)])
    assert found.front_mask[found.front_mask.any(-1)].tolist() == [[True, False, True], [True] * 3]
    assert found.directions[found.direction_mask].tolist() == [[0.0, 1.0, 0.0]]
    (rotation,) = found.rotations[found.rotation_mask]
    assert rotation.abs().tolist() == pytest.approx([math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0])
    assert found.rotations[~found.rotation_mask][0].tolist() == [1.0, 0.0, 0.0, 0.0]


def test_a_walk_says_where_the_pelvis_is_to_be() -> None:
    setup = Task(prompt="x", scene=Scene.empty(), start=[0.0, 0.0], walk={"to": [0.0, 3.0]}).build()
    found = conditions_of(setup.objective, setup.context, setup.start, setup.seconds, SPEC)
    assert len(found) >= 1 and set(found.joints.tolist()) == {0}
    last = found.times.argmax()
    assert found.positions[last, [0, 2]].tolist() == pytest.approx([0.0, 3.0], abs=0.05)


def test_what_has_no_time_of_its_own_is_left_out() -> None:
    sometime = Term("joint_target", {"joint": "head", "position": [0.0, 1.5, 1.0]}, sometime=[1.0, 2.0])
    assert not len(conditions_of(Objective((sometime, HEIGHT)), context(), Pose2D(), 3.0, SPEC))


@pytest.mark.parametrize("able", [False, True])
def test_families_that_take_conditions_are_handed_them(able: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    from dataclasses import replace

    generator, shown = Lively(), []
    abilities = generator.spec.abilities | ({"conditions"} if able else set())
    monkeypatch.setattr(generator, "spec", replace(generator.spec, abilities=abilities), raising=False)
    draft = generator.generate

    def look(*arguments: object, **named: object) -> object:
        shown.append(named["conditions"])
        return draft(*arguments, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(generator, "generate", look, raising=False)
    make(generator, "walks", 3.0, Pose2D(), Objective((WRIST,)), context())
    assert (shown[0] is not None) == able and (not able or shown[0].times.tolist() == [1.5])  # type: ignore[attr-defined]
