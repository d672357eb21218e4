"""Goals of directions: angles that are known, gradients everywhere, and one sentence for what cannot be meant."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
import torch
from hypothesis import given, settings, strategies as st
from torch import Tensor

from objectives import Term
from objectives.maths import angle_between
from scenes.errors import UserError
from scenes.motion.headings import turned
from scenes.motion.kinematics import forward
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.rotations import matrices
from scenes.motion.skeleton import HUMANML3D
from tests.objectives.cases import context, standing, wandering

QUIET = settings(max_examples=25, deadline=None)
angles = st.floats(-3.1, 3.1)
PARTS = ("pelvis", "chest", "head")


def worst(use: str, motion: Motion, **parameters: Any) -> float:
    return Term(use, parameters).report(motion, context())[0].worst


def facing(heading: float) -> Motion:
    return Motion(standing(3)).placed(Pose2D((0.4, 0.1, -0.3), heading))


def posed(**joints: tuple[float, float, float, float]) -> Motion:
    """A T-pose but for the local rotations of some joints."""
    rotations = torch.zeros(5, 22, 4, dtype=torch.float64)
    rotations[..., 0] = 1
    for name, quaternion in joints.items():
        rotations[:, HUMANML3D.index(name)] = torch.tensor(quaternion, dtype=torch.float64)
    return Motion(forward(rotations, torch.zeros(5, 3, dtype=torch.float64), HUMANML3D))


def about(axis: int, angle: float) -> tuple[float, float, float, float]:
    turn = [math.cos(angle / 2), 0.0, 0.0, 0.0]
    turn[1 + axis] = math.sin(angle / 2)
    return (turn[0], turn[1], turn[2], turn[3])


@QUIET
@given(angles, angles, st.sampled_from(PARTS))
def test_the_residual_is_the_angle_between_headings(turn: float, heading: float, part: str) -> None:
    apart = math.degrees(abs(math.remainder(turn - heading, 2 * math.pi)))
    assert worst("face", facing(turn), part=part, heading=heading) == pytest.approx(apart, abs=1e-5)
    direction = (3 * math.sin(heading), 5.0, 3 * math.cos(heading))
    tiny = [1e-290 * value for value in direction]  # a vector of any length
    assert worst("face", facing(turn), part=part, direction=tiny) == pytest.approx(apart, abs=1e-5)
    assert worst("face", facing(turn), part=part, direction=direction) == pytest.approx(apart, abs=1e-5)
    assert worst("face", facing(turn), part=part, heading=heading, within=20) == pytest.approx(
        max(0, apart - 20), abs=1e-5
    )


@QUIET
@given(angles, st.floats(0.3, 5.0), st.floats(-1.0, 2.0))
def test_a_place_is_faced_from_where_the_part_is(heading: float, away: float, height: float) -> None:
    body = facing(0.7)
    x, y, z = body.joint("pelvis")[0].tolist()
    place = [x + away * math.sin(heading), y + height, z + away * math.cos(heading)]
    apart = math.degrees(abs(math.remainder(heading - 0.7, 2 * math.pi)))
    assert worst("face", body, position=place) == pytest.approx(apart, abs=1e-5)
    assert worst("face", body, position=place[::2]) == pytest.approx(apart, abs=1e-5)
    still = {"kind": "line", "start": place, "end": place, "times": [0.0, 0.1]}
    assert worst("face", body, track=still) == pytest.approx(apart, abs=1e-5)


def test_lean_counts_where_it_is_asked() -> None:
    leaning = posed(pelvis=about(0, 0.4))
    assert worst("face", leaning, heading=0.0) == pytest.approx(0.0, abs=1e-5)
    assert worst("face", leaning, direction=(0, 0, 1), level=False) == pytest.approx(math.degrees(0.4), abs=1e-5)
    nodding = posed(neck=about(0, 0.3))
    assert worst("face", nodding, part="head", direction=(0, 0, 1), level=False) == pytest.approx(math.degrees(0.3))
    assert worst("face", nodding, part="chest", direction=(0, 0, 1), level=False) == pytest.approx(0.0, abs=1e-5)


def _gradient(use: str, joints: Tensor, **parameters: Any) -> Tensor:
    joints = joints.clone().requires_grad_()
    (found,) = torch.autograd.grad(Term(use, parameters).cost(Motion(joints), context()), joints)
    return found


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("level", [True, False])
def test_what_is_right_behind_pulls(part: str, level: bool, dtype: torch.dtype) -> None:
    joints = standing(1, dtype=dtype)
    found = _gradient("face", joints, part=part, direction=(0.0, 0.0, -1.0), level=level)
    assert found.isfinite().all() and found.norm() > 100  # deg^2 / 50 a metre, from 180 degrees
    a_little = joints - 1e-4 * found / found.norm()
    assert worst("face", Motion(a_little), part=part, direction=(0.0, 0.0, -1.0), level=level) < 179.99


def test_what_is_right_behind_a_bone_pulls() -> None:
    found = _gradient("bone_direction", standing(1), bone="left_wrist", direction=(-1.0, 0.0, 0.0))
    assert found.isfinite().all() and found.norm() > 100


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_half_a_turn_pulls(axis: int) -> None:
    found = _gradient("joint_rotation", standing(3), joint="pelvis", quaternion=about(axis, math.pi))
    assert found.isfinite().all() and found.norm() > 100


@QUIET
@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1), st.floats(0, 0.2))
def test_a_place_in_the_body_is_in_no_direction(x: float, y: float, z: float, away: float) -> None:
    joints = standing(1)
    place = (joints[0, 0] + away * torch.tensor([x, y, z], dtype=joints.dtype)).tolist()
    # 180 deg / 50 deg^2 times 2 rad / 0.1 m, for the place and for hips 0.1 m apart that turn the front
    assert _gradient("face", joints, position=place, level=False).norm() < 3 * 2 * (180 / 50) * 57.3 * 20
    here = joints[0, 0].tolist()
    assert worst("face", Motion(joints), position=here) == pytest.approx(90.0)


@QUIET
@given(st.lists(st.floats(-1, 1), min_size=6, max_size=6))
def test_angles_of_vectors_of_any_length(numbers: list[float]) -> None:
    a, b = torch.tensor(numbers, dtype=torch.float64).view(2, 3)
    found = float(angle_between(a, b, 0.01, 0.01))
    if a.norm() > 0.01 and b.norm() > 0.01:
        cosine = float((a @ b) / (a.norm() * b.norm()))
        assert math.cos(found) == pytest.approx(cosine, abs=1e-9)
    assert 0 <= found <= math.pi and found == pytest.approx(float(angle_between(b, a, 0.01, 0.01)))


@QUIET
@given(angles, st.sampled_from(["left_wrist", "right_knee", "head"]))
def test_a_bone_relative_to_the_body_goes_with_it(turn: float, bone: str) -> None:
    body = wandering()
    there = replace(body, joints=turned(body.joints, torch.tensor(turn, dtype=torch.float64)) + 1.0)
    for frame in ("pelvis", "chest"):
        asked = {"bone": bone, "direction": (0.3, -0.4, 1.0), "frame": frame}
        assert worst("bone_direction", there, **asked) == pytest.approx(worst("bone_direction", body, **asked))


def test_bones_and_limbs() -> None:
    body = Motion(standing(2))
    assert worst("bone_direction", body, bone="left_wrist", direction=(2, 0, 0)) == pytest.approx(0.0, abs=1e-5)
    arm = ["right_shoulder", "right_wrist"]
    assert worst("bone_direction", body, bone=arm, direction=(0, 1, 0)) == pytest.approx(90.0)
    assert worst("bone_direction", body, bone=arm, direction=(0, 1, 0), within=60) == pytest.approx(30.0)
    shoulder = body.joint("right_shoulder")[0]
    lamp = (shoulder + torch.tensor([-2.0, 2.0, 0.0])).tolist()
    assert worst("bone_direction", body, bone=arm, position=lamp) == pytest.approx(45.0)


@QUIET
@given(st.tuples(*[st.floats(-0.9, 0.9)] * 3), st.sampled_from(["pelvis", "spine3"]))
def test_rotations_are_those_that_carry_the_joints(euler: tuple[float, float, float], joint: str) -> None:
    degrees = [math.degrees(angle) for angle in euler]
    x, y, z = (matrices(torch.tensor(about(k, angle))) for k, angle in enumerate(euler))
    turn = y @ x @ z
    quaternion = torch.tensor([1 + float(turn.trace()), *_vee(turn)], dtype=torch.float64)
    w, i, j, k = (quaternion / quaternion.norm()).tolist()
    body = posed(**{joint: (w, i, j, k)})
    assert worst("joint_rotation", body, joint=joint, euler=degrees, frame="world") == pytest.approx(0.0, abs=0.01)
    assert worst("joint_rotation", body, joint=joint, quaternion=[-w, -i, -j, -k], frame="world") < 0.01
    size = math.degrees(2 * math.acos(min(1.0, abs(w))))
    still = worst("joint_rotation", Motion(standing(5)), joint=joint, euler=degrees)
    assert still == pytest.approx(size, abs=0.01)


def _vee(turn: Tensor) -> list[float]:
    return [float(turn[2, 1] - turn[1, 2]), float(turn[0, 2] - turn[2, 0]), float(turn[1, 0] - turn[0, 1])]


@pytest.mark.parametrize(
    ("joint", "euler"), [("left_knee", (80, 0, 0)), ("left_elbow", (0, -90, 0)), ("right_elbow", (0, 90, 0))]
)
def test_hinges_bend_about_their_axes(joint: str, euler: tuple[float, float, float]) -> None:
    axis, angle = next((k, math.radians(value)) for k, value in enumerate(euler) if value)
    body = posed(**{joint: about(axis, angle)})
    assert worst("joint_rotation", body, joint=joint, euler=euler) == pytest.approx(0.0, abs=0.01)
    assert worst("joint_rotation", Motion(standing(5)), joint=joint, euler=euler) == pytest.approx(sum(map(abs, euler)))


@pytest.mark.parametrize(
    ("use", "table", "sentence"),
    [
        ("face", {}, "needs one of position, track, heading and direction, not none"),
        ("face", {"heading": 1, "position": [0, 1]}, "needs one of .*, not 2"),
        ("face", {"heading": 90}, "'heading' is in radians, and 90 is more than a turn; 90 degrees are 1.571"),
        ("face", {"direction": [0, 1, 0]}, "is vertical and has no heading; give level = false"),
        ("face", {"direction": [0, 0, 0]}, "has no length and so points nowhere"),
        ("face", {"position": [0, 1], "level": False}, "has no height to look at"),
        ("face", {"part": "neck", "heading": 0}, "parameter 'part' must be 'pelvis', 'chest' or 'head', not 'neck'"),
        ("face", {"heading": 0, "within": 200}, "less than 180"),
        ("bone_direction", {"bone": "pelvis", "direction": [0, 1, 0]}, "no bone ends in 'pelvis'"),
        ("bone_direction", {"bone": "left_wrst", "direction": [0, 1, 0]}, "did you mean 'left_wrist'"),
        ("bone_direction", {"bone": ["head", "neck", "pelvis"], "direction": [0, 1, 0]}, "a joint or two different"),
        ("bone_direction", {"bone": "head"}, "needs one of position, track and direction, not none"),
        ("bone_direction", {"bone": "head", "position": [0, 1, 0], "frame": "pelvis"}, "places are the world's"),
        ("joint_rotation", {"joint": "left_wrist", "euler": [0, 0, 0]}, "'left_wrist' ends a limb.*: pelvis, left_hip"),
        ("joint_rotation", {"joint": "pelvis"}, "needs either 'quaternion' or 'euler'"),
        ("joint_rotation", {"joint": "pelvis", "quaternion": [1, 1, 0, 0]}, "has a length of 1.41; give w, x, y, z"),
        (
            "bone_direction",
            {"bone": "left_hip", "direction": [0, 0, 1], "frame": "pelvis"},
            "one rigid piece with 'pel",
        ),
        ("bone_direction", {"bone": ["neck", "left_collar"], "direction": [0, 0, 1], "frame": "chest"}, "'spine3'"),
        ("joint_rotation", {"joint": "left_knee", "euler": [-90, 0, 0]}, "about x .* bend 90 degrees the wrong way"),
        ("joint_rotation", {"joint": "left_elbow", "euler": [0, 60, 0]}, "about -y .* bend 60 degrees the wrong way"),
        ("joint_rotation", {"joint": "left_elbow", "euler": [0, 0, 90]}, "a hinge that bends about -y of its parent"),
        ("joint_rotation", {"joint": "left_knee", "euler": [0, 50, 0]}, "bends about x .* turn 50 degrees about other"),
    ],
)
def test_what_cannot_be_meant_is_a_sentence(use: str, table: dict[str, Any], sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        Term.from_table({"use": use, **table}).evaluate(Motion(standing(3)), context())


def test_angles_count_as_the_way_of_a_hand() -> None:
    """What refinement holds in metres holds for angles, and for nothing else."""
    facing, reach = Term("face", {"heading": 0.0}, tolerance=0.1), Term("joint_target", {"position": [0, 1, 0]})
    assert facing.loosened(0.01).allowed == pytest.approx(1.0) and facing.loosened(0.0001) is facing
    assert reach.loosened(0.1).allowed == 0.1
    assert facing.spec.pulls and not facing.spec.draws and reach.spec.draws
