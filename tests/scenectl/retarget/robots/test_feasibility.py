"""Feasibility: torques, supports, slides, depths and slower stretches where each is known by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch

from scenectl.retarget.plants import Plant
from scenectl.retarget.robots.dynamics import dynamics, half_speeds, torque_limits
from scenectl.retarget.robots.feasibility import Stretch, feasibility, slower, stretches
from scenectl.retarget.robots.robot import Robot
from scenectl.retarget.robots.standing import outside, sole_of, standing
from scenectl.retarget.robots.trajectory import Trajectory
from scenes.mesh.primitives import Sphere
from scenes.motion.motion import Motion
from scenes.world.scene import Scene

HUMANOID = Path(__file__).with_name("humanoid.xml")
G = 9.81


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot(HUMANOID)


def trajectory(robot: Robot, qpos: np.ndarray, fps: float = 50.0, feet: str = "left right") -> Trajectory:
    """A trajectory whose named feet stand all along."""
    plants = tuple(Plant(f"{side}_foot", 0, len(qpos), np.zeros(3)) for side in feet.split())
    return Trajectory(robot, qpos, fps, Motion(torch.zeros(len(qpos), 22, 3)), plants)


def still(robot: Robot, frames: int = 3, **joints: float) -> np.ndarray:
    """The robot upright, some of its joints turned, ``[frames, nq]``."""
    q = robot.model.qpos0.copy()
    for name, angle in joints.items():
        q[robot.model.joint(name).qposadr[0]] = angle
    return np.tile(q, (frames, 1))


def test_soles_are_the_corners_of_the_feet(robot: Robot) -> None:
    sole = sole_of(robot, "left")
    found = {tuple(point) for point in sole.points.round(6).tolist()}
    assert found == {(x, y, -0.04) for x in (-0.06, 0.14) for y in (-0.035, 0.035)} and sole.friction == 1.0


@pytest.mark.parametrize("angle", [0.0, -0.5, -np.pi / 2, -2.0])
def test_holding_a_forearm_takes_its_weight_times_its_lever(robot: Robot, angle: float) -> None:
    path = trajectory(robot, still(robot, left_elbow=angle))
    found = dynamics(path, standing(path))
    elbow = robot.names.index("left_elbow")
    # turning about y from hanging down brings the forearm ahead where the angle is negative
    np.testing.assert_allclose(found.torques[:, elbow], 1.0 * G * 0.1 * np.sin(angle), atol=1e-6)
    np.testing.assert_allclose(found.still, found.torques, atol=1e-9)


@pytest.mark.parametrize("feet", ["left right", "left"])
def test_the_ground_carries_who_stands_and_ankles_what_is_ahead_of_them(robot: Robot, feet: str) -> None:
    path = trajectory(robot, still(robot, waist_pitch=0.2), feet=feet)
    feet_found = standing(path)
    found = dynamics(path, feet_found)
    np.testing.assert_allclose(found.zmp, found.mass_centre[:, :2], atol=1e-9)
    if feet == "left right":
        assert np.abs(found.missing).max() < 1e-2
        data = mujoco.MjData(robot.model)
        data.qpos[:] = path.qpos[0]
        mujoco.mj_forward(robot.model, data)
        legs = [robot.model.body(f"{side}_foot").id for side in ("left", "right")]
        above = data.subtree_com[1, 0] * 29.0 - sum(data.xipos[foot, 0] * 0.5 for foot in legs)
        lever = above - 28.0 * data.xpos[legs[0], 0]
        ankles = [robot.names.index(f"{side}_ankle_pitch") for side in ("left", "right")]
        # what leans ahead turns about +y, and the ankles hold it from below
        assert found.torques[0, ankles].sum() == pytest.approx(lever * G, abs=0.05)
        assert found.torques[0, ankles[0]] == pytest.approx(found.torques[0, ankles[1]], abs=0.05)
    np.testing.assert_allclose(feet_found.outside(found.zmp), feet_found.outside(found.mass_centre[:, :2]), atol=1e-6)


def test_what_leans_too_far_is_not_carried(robot: Robot) -> None:
    one = feasibility(trajectory(robot, still(robot), feet="left"))
    assert one.missing_moment + 0.05 * one.missing_force > 5.0 and one.zmp.outside > 0.05
    lifted = feasibility(trajectory(robot, still(robot), feet=""))
    assert lifted.standing == 0.0 and lifted.missing_force == pytest.approx(29.0 * G, rel=1e-6)


def test_places_are_as_far_outside_a_polygon_as_drawing_says() -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 0.5]])
    for place, away in (((0.2, 0.7), 0.0), ((1.3, 0.4), 0.3), ((-0.3, -0.4), 0.5), ((1.0, 1.0), 0.0)):
        assert outside(np.array(place), square) == pytest.approx(away, abs=1e-5)
    assert outside(np.array([0.5, 0.2]), square[:2]) == pytest.approx(0.2, abs=1e-5)
    assert outside(np.array([3.0, 4.0]), square[:1]) == pytest.approx(5.0, abs=1e-5)


def test_the_centre_of_mass_is_outside_of_one_foot_by_how_far_it_is_from_its_edge(robot: Robot) -> None:
    both, one = (feasibility(trajectory(robot, still(robot), feet=feet)) for feet in ("left right", "left"))
    assert both.mass_centre.inside == both.zmp.inside == 1.0 and both.mass_centre.outside == 0.0
    assert one.mass_centre.inside == 0.0
    assert one.mass_centre.outside == pytest.approx(
        0.09 - 0.035, abs=1e-5
    )  # the inner edge is that far from the middle


def test_feet_at_rest_don_t_slide_and_others_do_by_how_far_they_went(robot: Robot) -> None:
    q = still(robot, 20)
    assert feasibility(trajectory(robot, q)).slide.metres == 0.0
    q[10:, 0] += np.linspace(0, 0.03, 10)
    slid = feasibility(trajectory(robot, q)).slide
    assert slid.metres == pytest.approx(0.03) and slid.seconds == pytest.approx(19 / 50)
    turned, angles = still(robot, 20), np.linspace(0, 0.5, 20)
    turned[:, 3], turned[:, 6] = np.cos(angles / 2), np.sin(angles / 2)
    found = feasibility(trajectory(robot, turned, feet="left"))  # about the middle of both feet, 0.09 m from the left's
    assert found.turn == pytest.approx(np.degrees(0.5), abs=1e-3)
    nearest = np.hypot(0.06, 0.055)  # the heel's inner corner
    assert found.slide.metres == pytest.approx(2 * nearest * np.sin(0.25), abs=1e-6)
    lifted = still(robot, 20)
    lifted[10:, 2] += 0.2  # in the air nothing slides
    lifted[10:, 0] += 0.5
    assert feasibility(trajectory(robot, lifted), Scene.empty()).slide.metres == 0.0


def test_depth_in_a_scene_is_that_of_the_shapes(robot: Robot) -> None:
    q = still(robot, 5)
    q[3, 2] -= 0.03
    deep = feasibility(trajectory(robot, q), Scene.empty()).scene
    assert deep is not None and deep.metres == pytest.approx(0.03, abs=1e-4)
    assert deep.what.endswith("foot") and deep.seconds == pytest.approx(3 / 50)
    ball = Scene([], [Sphere((0.0, 1.14, 0.17), 0.12)])  # before the skull, whose radius is 0.07
    deep = feasibility(trajectory(robot, still(robot)), ball).scene
    assert deep is not None and deep.what == "torso" and deep.metres == pytest.approx(0.02, abs=2e-3)
    assert feasibility(trajectory(robot, still(robot))).scene is None


def test_depth_in_itself_is_that_of_its_capsules(robot: Robot) -> None:
    assert feasibility(trajectory(robot, still(robot))).itself.metres == 0.0
    closed = feasibility(trajectory(robot, still(robot, left_hip_roll=-0.3, right_hip_roll=0.3)))
    assert closed.itself.metres > 0.03 and "left" in closed.itself.what and "right" in closed.itself.what


def swing(robot: Robot, factor: float = 1.0, hertz: float = 3.0) -> Trajectory:
    """A leg that swings in the air, `factor` times slower, at as many frames."""
    q = still(robot, 200)
    phase = 2 * np.pi * hertz * np.arange(len(q)) / 200
    q[:, robot.model.joint("left_hip_pitch").qposadr[0]] = 0.6 * np.sin(phase)
    return trajectory(robot, q, 200.0 / factor, feet="")


def test_twice_as_long_halves_speeds_and_quarters_what_moving_takes(robot: Robot) -> None:
    fast, slow = swing(robot, 1.0, 1.0), swing(robot, 2.0, 1.0)
    np.testing.assert_allclose(half_speeds(slow), half_speeds(fast) / 2, atol=1e-9)
    moving = [found.torques - found.still for found in (dynamics(path, standing(path)) for path in (fast, slow))]
    hip = robot.names.index("left_hip_pitch")
    inner = slice(30, -30)  # filters see the ends
    assert np.abs(moving[0][inner, hip]).max() > 5
    np.testing.assert_allclose(moving[1][inner, hip], moving[0][inner, hip] / 4, atol=0.05)


def test_slowed_down_by_what_it_says_every_limit_holds_and_no_less_does(robot: Robot) -> None:
    limits = torque_limits(robot.model)
    hip = robot.names.index("left_hip_pitch")
    path = swing(robot)
    found = dynamics(path, standing(path))
    assert np.abs(found.torques[:, hip]).max() > limits[hip]
    (part, *_) = stretches(path, found, limits)
    factor = float(slower(path, found, limits)[0].max())
    assert factor > 1.1 and "left_hip_pitch" in part.why
    slowed = swing(robot, factor)
    again = dynamics(slowed, standing(slowed))
    assert np.abs(again.torques[:, hip]).max() == pytest.approx(limits[hip], rel=0.05)
    assert (
        list(stretches(swing(robot, 1.1 * factor), dynamics(swing(robot, 1.1 * factor), standing(slowed)), limits))
        == []
    )


def test_what_no_motor_can_hold_is_told(robot: Robot) -> None:
    path = trajectory(robot, still(robot, left_hip_pitch=-1.5), feet="")
    found, limits = dynamics(path, standing(path)), torque_limits(robot.model)
    limits[robot.names.index("left_hip_pitch")] = 5.0
    (part,) = stretches(path, found, limits)
    assert np.isinf(part.factor) and "left_hip_pitch takes" in part.why


def test_speeds_beyond_their_limit_ask_for_as_much_time(robot: Robot) -> None:
    q = still(robot, 11)
    q[:, robot.model.joint("left_elbow").qposadr[0]] = np.linspace(0, -2, 11)  # 10 rad/s
    found = feasibility(trajectory(robot, q))
    elbow = next(joint for joint in found.joints if joint.name == "left_elbow")
    assert elbow.speed == pytest.approx(10.0) and elbow.speed_used == pytest.approx(10 / (3 * np.pi))
    assert not found.within
    assert max(part.factor for part in found.stretches) >= 10 / (3 * np.pi)
    assert elbow.range_used == pytest.approx(1.0)  # it begins at the end of its range


def test_torque_limits_are_those_of_the_file(robot: Robot) -> None:
    limits = dict(zip(robot.names, torque_limits(robot.model), strict=True))
    assert limits["left_hip_pitch"] == 90.0 and limits["right_knee"] == 120.0
    assert limits["left_ankle_pitch"] == 40.0  # through a gear of 2
    assert np.isinf(limits["waist_yaw"])


def test_reports_are_written_as_json_and_say_what_is_unknown(robot: Robot, tmp_path: Path) -> None:
    found = feasibility(trajectory(robot, still(robot)), Scene.empty())
    found.save(tmp_path / "report.json")
    table = json.loads((tmp_path / "report.json").read_text())
    assert table["within_limits"] is True and len(table["joints"]) == 23 and table["slide"]["metres"] == 0.0
    said = " ".join(found.sentences())
    assert "states no torque limit for 17 of 23 joints" in said and "no speed limit for 23 of 23" in said
    endless = replace(found, stretches=(Stretch(0.0, 1.0, float("inf"), "a knee takes 200 of 120 N m"),))
    endless.save(tmp_path / "report.json")
    assert json.loads((tmp_path / "report.json").read_text())["stretches"][0]["factor"] is None
    assert "cannot be held at any speed" in " ".join(endless.sentences())
