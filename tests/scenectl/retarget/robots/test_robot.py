"""Robots that follow motions: near them, within their ranges and speeds, on feet that stand."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st

from scenectl.retarget.robots.capsules import carried, poses
from scenectl.retarget.robots.points import WORLD
from scenectl.retarget.robots.robot import Robot
from scenectl.retarget.robots.standing import sole_of
from scenectl.retarget.robots.targets import resampled
from scenes.errors import UserError
from scenes.mesh.scale import TO_Y_UP
from scenes.motion.frames import about_y
from scenes.motion.motion import Motion
from tests.scenectl.retarget.robots.humanoids import dancing, mjcf, person, saved, walking


@lru_cache
def robot(size: float = 1.0, tight: float = 0.0, speed: float = 10.0) -> Robot:
    """A robot of our proportions; `tight` narrows its ranges by so much on either side."""
    links = [replace(link, range=(link.range[0] + tight, link.range[1] - tight)) for link in person(size)]
    with TemporaryDirectory() as folder:
        return Robot(saved(Path(folder), mjcf(links)), speed=speed)


def off(motion: Motion, made: np.ndarray, name: str) -> np.ndarray:
    """Metres between one of our joints and the robot's."""
    distances: np.ndarray = np.linalg.norm(made - motion.joint(name).numpy() @ WORLD.T, axis=1)
    return distances


@pytest.mark.parametrize("seed", range(3))
def test_a_robot_of_our_proportions_follows_us(seed: int) -> None:
    motion = dancing(seed)
    made, again = robot().retarget(motion), resampled(motion, 50.0)
    for part in ("hip", "shoulder", "elbow", "wrist"):
        for side in ("left", "right"):
            name = f"{side}_{part}"
            assert np.median(off(again, made.joint(name), name)) < 0.01, name
            assert np.median(off(made.source, made.joint(name), name)) < 0.01, name
    for name in ("left_knee", "right_knee", "left_ankle", "right_ankle", "left_foot"):
        assert np.median(off(made.source, made.joint(name), name)) < 0.01, name


def test_a_walk_is_walked(seconds: float = 3.0) -> None:
    motion = walking(seconds)
    made, again = robot().retarget(motion), resampled(motion, 50.0)
    assert made.frames == again.frames and made.fps == 50 and motion.times[-1] - made.times[-1] < 1 / 50
    for name in ("left_ankle", "right_knee", "left_wrist", "right_elbow"):
        assert off(again, made.joint(name), name).max() < 0.015, name
    assert len(made.plants) >= 4


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 1000),
    size=st.sampled_from([0.5, 0.8, 1.2]),
    tight=st.sampled_from([0.0, 0.1, 0.3]),
    speed=st.sampled_from([0.5, 3.0, 10.0]),
    fps=st.sampled_from([20.0, 30.0, 50.0, 60.0]),
)
def test_ranges_and_speeds_are_never_exceeded(seed: int, size: float, tight: float, speed: float, fps: float) -> None:
    machine = robot(size, tight if tight < 0.1 else 0.1, speed)
    made = machine.retarget(dancing(seed, 20, most=1 + 5 * tight), fps)
    joints = made.qpos[:, 7:].round(6)  # as files have them
    assert (joints > machine.ranges[:, 0]).all() and (joints < machine.ranges[:, 1]).all()
    assert (np.abs(np.diff(joints, axis=0)) * fps <= machine.speeds).all()
    assert np.isfinite(made.qpos).all() and np.allclose(np.linalg.norm(made.qpos[:, 3:7], axis=1), 1)
    figures = made.figures()
    assert figures.speed <= 1 and figures.beyond < 0


@pytest.mark.parametrize("size", [0.6, 1.0, 1.4])
@pytest.mark.parametrize("toes", [0.0, 0.3])
def test_standing_feet_stay_and_lie_flat_on_the_ground(size: float, toes: float) -> None:
    made = robot(size).retarget(walking(toes=toes))
    feet = [plant for plant in made.plants if plant.joint.endswith("foot")]
    assert len(feet) >= 4 and made.figures().slide < 0.02
    for plant in feet:
        path = made.joint(plant.joint)[plant.begin : plant.end]
        assert np.linalg.norm(path[:, :2] - path[:, :2].mean(axis=0), axis=1).max() < 0.02
        assert np.abs(path[:, 2]).max() < 0.01, "soles stand on the ground at 0"
        assert np.allclose(path.mean(axis=0), WORLD @ plant.place, atol=0.01)


def test_feet_that_drift_in_the_motion_stand_still_on_the_robot() -> None:
    motion = walking()
    joints, feet = motion.joints.clone(), [f"{side}_{part}" for side in ("left", "right") for part in ("ankle", "foot")]
    joints[:, motion.skeleton.indices(feet), 0] += 0.04 * torch.sin(4 * motion.times)[:, None]
    made = robot().retarget(replace(motion, joints=joints))
    longest = max(made.plants, key=lambda plant: plant.end - plant.begin)
    drifted = resampled(replace(motion, joints=joints), 50.0).joint(longest.joint)[longest.begin : longest.end]
    assert float((drifted - drifted.mean(dim=0)).norm(dim=1).max()) > 0.02 > 0.01 > made.figures().slide


def test_no_heel_is_lower_than_a_ball_that_stands() -> None:
    motion = walking(1.0)
    joints = motion.joints[:1].repeat(motion.frames, 1, 1)
    ankle, foot = (motion.skeleton.index(f"left_{part}") for part in ("ankle", "foot"))
    arm, turn = joints[0, ankle] - joints[0, foot], 1.2 * motion.times
    joints[:, ankle, 0] += arm[2] * turn.sin()  # the foot turns on its ball, toes up
    joints[:, ankle, 2] += arm[2] * (turn.cos() - 1)
    joints[:, ankle, 1] -= 0.05
    made = robot().retarget(replace(motion, joints=joints))
    begin, end = next((plant.begin, plant.end) for plant in made.plants if plant.joint == "left_foot")
    sole = sole_of(made.robot, "left")
    places = carried(*poses(made.robot.model, made.qpos[begin:end]), sole.bodies, sole.points)
    assert end - begin > 10 and np.ptp(places[..., 2], axis=1).max() < 0.01


def test_the_way_is_as_long_as_the_legs_make_it() -> None:
    motion = walking()
    ways = [robot(size).retarget(motion).qpos[:, :2] for size in (0.6, 1.2)]
    lengths = [float(np.linalg.norm(way[-1] - way[0])) for way in ways]
    assert lengths[1] / lengths[0] == pytest.approx(2, rel=0.01)
    assert lengths[1] / 1.2 == pytest.approx(
        float(motion.joint("pelvis")[-1, 2] - motion.joint("pelvis")[0, 2]), rel=0.01
    )


def test_our_world_is_turned_as_scenes_turn_it() -> None:
    assert np.array_equal(TO_Y_UP["z"], WORLD.T)
    way = robot().retarget(walking()).qpos[:, :2]
    assert way[-1, 1] - way[0, 1] < -2 and abs(way[-1, 0] - way[0, 0]) < 0.05, "+z is -y in the robot's world"


@settings(max_examples=5, deadline=None)
@given(angle=st.floats(-3, 3), x=st.floats(-50, 50), y=st.floats(-3, 3), z=st.floats(-50, 50))
def test_who_starts_elsewhere_does_the_same_there(angle: float, x: float, y: float, z: float) -> None:
    motion, turn = walking(1.5), np.array(about_y(angle))
    place = torch.tensor([x, y, z], dtype=torch.float64)
    moved = replace(motion, joints=motion.joints @ torch.from_numpy(turn).T + place)
    here, there = robot().retarget(motion), robot().retarget(moved)
    assert np.allclose(here.qpos[:, 7:], there.qpos[:, 7:], atol=2e-3)
    about_z = WORLD @ turn @ WORLD.T
    assert np.allclose(here.qpos[:, :3] @ about_z.T + WORLD @ place.numpy(), there.qpos[:, :3], atol=2e-3)


def test_robots_of_any_facing_do_the_same(tmp_path: Path) -> None:
    motion, made = walking(1.5), []
    for turn in (0.0, math.pi / 2, 2.5):
        made.append(Robot(saved(tmp_path, mjcf(person(), turn=turn))).retarget(motion).qpos)
    for other in made[1:]:
        assert np.allclose(made[0], other, atol=2e-3)


def test_several_motions_make_several_trajectories() -> None:
    one, two = dancing(0), dancing(1)
    both = replace(one, joints=torch.stack([one.joints, two.joints]), valid=torch.stack([one.valid, two.valid]))
    made = robot().retarget(both)
    assert isinstance(made, list) and len(made) == 2
    assert np.array_equal(made[1].qpos, robot().retarget(two).qpos)


def test_frames_that_are_padding_count_for_nothing() -> None:
    motion = dancing(0)
    padded = Motion(
        torch.cat([motion.joints, motion.joints[-1:].expand(10, -1, -1) + 5]), torch.arange(50) < 40, motion.fps
    )
    assert np.array_equal(robot().retarget(padded).qpos, robot().retarget(motion).qpos)


def test_a_single_frame_is_a_pose() -> None:
    motion = dancing(0)
    assert robot().retarget(replace(motion, joints=motion.joints[:1], valid=motion.valid[:1])).frames == 1


def test_what_cannot_be_followed_is_said() -> None:
    motion = dancing(0)
    with pytest.raises(UserError, match="without a valid frame"):
        robot().retarget(replace(motion, valid=torch.zeros(40, dtype=torch.bool)))
    joints = motion.joints.clone()
    joints[5, 3] = math.inf
    with pytest.raises(UserError, match="NaN or infinite"):
        robot().retarget(replace(motion, joints=joints))
    with pytest.raises(UserError, match="frames a second"):
        robot().retarget(motion, math.nan)
    with pytest.raises(UserError, match="22 joints"):
        robot().retarget(replace(motion, skeleton=replace(motion.skeleton, names=tuple("abcdefghijklmnopqrstuv"))))
    with pytest.raises(UserError, match="no 'neck'"):
        robot().retarget(motion).joint("neck")
