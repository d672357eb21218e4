"""A robot's capsules: where they are, which of them may not meet, and steps that keep them clear of things."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mink
import mujoco
import numpy as np
import pytest
import torch
from scipy.optimize import minimize

from scenectl.retarget.robots.avoid import REACH, Avoidance, SceneAvoidance, SelfAvoidance, scene_distance
from scenectl.retarget.robots.capsules import NEAR, capsules_of, poses, segments_apart
from scenectl.retarget.robots.robot import Robot
from scenes.mesh.primitives import Box, Plane, Sphere
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import Scene
from tests.scenectl.retarget.robots.humanoids import mjcf, person, saved

HUMANOID = Path(__file__).with_name("humanoid.xml")


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot(HUMANOID)


def some_poses(robot: Robot, count: int, seed: int = 0) -> np.ndarray:
    """Random poses within the limits of joints, somewhere and turned somehow, ``[count, nq]``."""
    random = np.random.default_rng(seed)
    q = np.tile(robot.model.qpos0, (count, 1))
    q[:, 7:] = robot.ranges[:, 0] + random.random((count, len(robot.ranges))) * np.ptp(robot.ranges, axis=1)
    q[:, :3] += 0.3 * random.standard_normal((count, 3))
    q[:, 3:7] = random.standard_normal((count, 4))
    q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
    return q


def at(robot: Robot, q: np.ndarray) -> Any:
    data = mujoco.MjData(robot.model)
    data.qpos[:] = q
    mujoco.mj_kinematics(robot.model, data)
    mujoco.mj_comPos(robot.model, data)
    return data


def moved(robot: Robot, q: np.ndarray, step: np.ndarray) -> np.ndarray:
    after = q.copy()
    mujoco.mj_integratePos(robot.model, after, step, 1.0)
    return after


def test_capsules_of_the_file_stand_for_themselves_and_others_hold_their_shapes(robot: Robot) -> None:
    capsules = capsules_of(robot)
    assert capsules_of(robot) is capsules and capsules.sole == pytest.approx(0.0, abs=1e-9)
    pelvis = capsules.links.index("pelvis")
    np.testing.assert_allclose(np.sort(capsules.ends[pelvis], axis=0), [[0, -0.05, 0], [0, 0.05, 0]], atol=1e-9)
    assert capsules.radii[pelvis] == 0.06 and capsules.links.count("torso") == 2
    foot = capsules.links.index("left_foot")
    a, b = capsules.ends[foot]
    corners = np.array([[x, y, z] for x in (-0.06, 0.14) for y in (-0.035, 0.035) for z in (-0.04, -0.01)])
    share = np.clip((corners - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    away = np.linalg.norm(corners - a - share[:, None] * (b - a), axis=1)
    assert (away <= capsules.radii[foot] + 1e-6).all()


def test_what_may_not_meet_are_pairs_that_are_apart_in_the_file_and_on_no_common_joint(robot: Robot) -> None:
    capsules = capsules_of(robot)
    pairs = {frozenset((capsules.links[i], capsules.links[j])) for i, j in capsules.pairs}
    assert frozenset(("left_shin", "right_shin")) in pairs and frozenset(("left_forearm", "pelvis")) in pairs
    assert frozenset(("left_thigh", "left_shin")) not in pairs and frozenset(("pelvis", "torso")) not in pairs
    places = capsules.placed(*poses(robot.model, robot.model.qpos0[None]))[0]
    assert (capsules.self_distances(places).distance > NEAR).all()


def test_links_of_one_limb_and_of_the_next_may_meet(tmp_path: Path) -> None:
    ball = ((0.0, 0.0, 0.0), (0.01, 0.01, 0.01))
    apart = {"hip_roll_link": (0.0, 0.0, -0.05), "shoulder_roll_link": (0.0, 0.0, -0.05)}
    links = [
        replace(
            link, box=link.box or ball, offset=next((at for end, at in apart.items() if end in link.name), link.offset)
        )
        for link in person()
    ]
    capsules = capsules_of(Robot(saved(tmp_path, mjcf(links))))
    pairs = {frozenset((capsules.links[i], capsules.links[j])) for i, j in capsules.pairs}
    for a, b in (("pelvis", "left_hip_yaw_link"), ("left_hip_pitch_link", "left_knee_link"),
                 ("torso_link", "left_shoulder_yaw_link"), ("left_hip_pitch_link", "left_hip_yaw_link")):  # fmt: skip
        assert frozenset((a, b)) not in pairs, (a, b)
    for a, b in (("left_knee_link", "right_knee_link"), ("left_wrist_link", "pelvis")):
        assert frozenset((a, b)) in pairs, (a, b)


def test_segments_are_as_far_apart_as_minimising_says() -> None:
    random = np.random.default_rng(3)
    first, second = random.standard_normal((2, 40, 2, 3))
    first[0, 1], second[1, 1] = first[0, 0], second[1, 0]  # points
    first[2, 1] = second[2, 1] = 0.0
    second[3] = first[3] + [0.0, 0.0, 1.0]  # parallel
    found, a, b = segments_apart(first, second)
    for k in range(len(first)):

        def apart(u: np.ndarray, k: int = k) -> float:
            ends = [f[k, 0] + share * (f[k, 1] - f[k, 0]) for f, share in zip((first, second), u, strict=True)]
            return float(((ends[0] - ends[1]) ** 2).sum())

        best = min(minimize(apart, start, bounds=[(0, 1)] * 2).fun for start in ([0.5, 0.5], [0, 1], [1, 0]))
        assert found[k] ** 2 == pytest.approx(best, abs=1e-7)
    np.testing.assert_allclose(np.linalg.norm(a - b, axis=1), found)


def test_gradients_of_gaps_are_differences(robot: Robot) -> None:
    avoid, compared = SelfAvoidance(robot), 0
    for q in some_poses(robot, 25):
        capsules = avoid.capsules

        def gaps(q: np.ndarray, capsules: Any = capsules) -> np.ndarray:
            return capsules.self_distances(capsules.placed(*poses(robot.model, q[None]))[0]).distance

        here, rows = gaps(q), avoid.rows(at(robot, q))
        near = np.array([int(np.abs(here - distance).argmin()) for distance in rows.distance], dtype=int)
        np.testing.assert_allclose(rows.distance, here[near])
        low = np.flatnonzero(here < avoid.margin + REACH)
        bodies = capsules.bodies[capsules.pairs]
        assert {tuple(pair) for pair in bodies[low]} == {tuple(pair) for pair in bodies[near]}
        for k, step in enumerate(1e-6 * np.eye(robot.model.nv)):
            change = (gaps(moved(robot, q, step)) - gaps(moved(robot, q, -step)))[near] / 2e-6
            np.testing.assert_allclose(rows.gradient[:, k], change, atol=1e-5)
        compared += len(near)
    assert compared > 20


def test_distances_to_a_scene_are_those_of_the_world_turned_and_so_are_their_gradients() -> None:
    scene = Scene([], [Box((1.0, 0.5, -2.0), (0.3, 0.4, 0.5)), Sphere((0.0, 1.0, 0.0), 0.2)])
    random = np.random.default_rng(0)
    points = random.standard_normal((50, 3))
    distance, gradient = scene_distance(scene, points, np.zeros(50))
    ours = np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1)
    np.testing.assert_allclose(distance, scene.distance(torch.from_numpy(ours)).numpy())
    for axis, step in enumerate(1e-6 * np.eye(3)):
        there, back = (scene_distance(scene, points + sign * step, np.zeros(50))[0] for sign in (1, -1))
        np.testing.assert_allclose(gradient[:, axis], (there - back) / 2e-6, atol=1e-5)


def test_gradients_to_a_scene_are_differences(robot: Robot) -> None:
    scene = Scene([], [Box((0.0, 0.5, -0.3), (0.5, 0.5, 0.5)), Plane((0.0, 0.0, 0.0))])
    avoid = SceneAvoidance(robot, scene)
    q = some_poses(robot, 4)
    avoid.look(q, 50.0)
    compared = 0
    for frame in range(len(q)):
        avoid.frame = frame
        rows = avoid.rows(at(robot, q[frame]))
        for k, step in enumerate(1e-6 * np.eye(robot.model.nv)):
            ahead, behind = (avoid.rows(at(robot, moved(robot, q[frame], sign * step))) for sign in (1, -1))
            if len(ahead.distance) == len(behind.distance) == len(rows.distance):
                change = (ahead.distance - behind.distance) / 2e-6
                np.testing.assert_allclose(rows.gradient[:, k], change, atol=1e-5)
                compared += len(change)
    assert compared > 100


def test_soles_stand_on_the_floor_and_nothing_is_too_near(robot: Robot) -> None:
    avoid = SceneAvoidance(robot, Scene.empty())
    assert avoid.look(robot.model.qpos0[None], 50.0) == pytest.approx(0.0, abs=1e-6)
    sunk = robot.model.qpos0.copy()
    sunk[2] -= 0.03
    assert avoid.look(sunk[None], 50.0) == pytest.approx(0.03, abs=1e-6)


def test_moving_things_are_met_when_they_are_there(robot: Robot) -> None:
    way = Trajectory((0.0, 1.0), ((5.0, 0.9, 0.0), (0.0, 0.9, 0.0)))  # at the robot after a second
    thing = MovingObject(Sphere((0.0, 0.0, 0.0), 0.1), way)
    for t0, hit in ((0.0, False), (1.0, True)):
        depth = SceneAvoidance(robot, Scene([], [], objects=[thing]), t0).look(robot.model.qpos0[None], 50.0)
        assert (depth > 0.05) == hit


def solved(robot: Robot, avoid: Avoidance, q: np.ndarray, steps: int, hard: bool) -> mink.Configuration:
    """A forearm that is drawn to the middle of the torso, with avoidance as a task or as a limit as well."""
    configuration = mink.Configuration(robot.model, q)
    hand = mink.FrameTask("left_forearm", "body", position_cost=10.0, orientation_cost=0.0)
    hand.set_target(mink.SE3.from_translation(np.array([0.0, 0.0, 0.85])))
    stay = mink.FrameTask("pelvis", "body", position_cost=100.0, orientation_cost=100.0)
    stay.set_target_from_configuration(configuration)
    limits = [mink.ConfigurationLimit(robot.model), *([avoid] if hard else [])]
    for _ in range(steps):
        dq = mink.solve_ik(configuration, [hand, stay, avoid], 0.02, "daqp", damping=1e-3, limits=limits)
        configuration.integrate_inplace(np.clip(dq, -5, 5), 0.02)
        configuration.check_limits(safety_break=True)
    return configuration


@pytest.mark.parametrize("hard", [False, True])
def test_a_hand_that_is_drawn_into_the_chest_stops_before_it(robot: Robot, hard: bool) -> None:
    capsules, q = capsules_of(robot), robot.model.qpos0.copy()
    q[7:] = np.clip(0.0, *(robot.ranges + np.array([0.01, -0.01])).T)

    def least(avoid: Avoidance) -> float:
        data = solved(robot, avoid, q, 120, hard).data
        places = capsules.placed(data.xpos[None], data.xmat.reshape(1, -1, 3, 3))[0]
        return float(capsules.self_distances(places).distance.min())

    assert least(SelfAvoidance(robot)) > (0.0 if hard else -0.01)
    if not hard:
        assert least(SelfAvoidance(robot, cost=0.0)) < -0.02
