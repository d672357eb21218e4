"""Metrics against motions whose figures are known by construction."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch import Tensor

from scenectl.measures.metrics import (
    BESIDE,
    Scorer,
    bone_length_drift,
    lowest_sole,
    max_acceleration,
    measure,
    pose_change,
    seam_ratio,
    skating_ratio,
    travelled,
)
from scenes.body.body import DEFAULT_BODY
from scenes.mesh.primitives import Box, Sphere
from scenes.motion.bones import standing_pose
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.skeleton import HUMANML3D
from scenes.motion.waypoints import Waypoints
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import Scene
from tests.scenectl.small import walk


def standing(frames: int = 40) -> Tensor:
    """A person at rest, lowest joint at y = 0, ``[T, 22, 3]``."""
    joints = standing_pose(HUMANML3D)
    joints[:, 1] -= joints[:, 1].min()
    return joints.float().expand(frames, 22, 3).clone()


def sliding(speed: float, frames: int = 40) -> Motion:
    """A statue pushed along +z at `speed` m/s."""
    joints = standing(frames)
    joints[..., 2] += speed * torch.arange(frames)[:, None] / 20
    return Motion(joints)


def skating_by_hand(feet: np.ndarray) -> float:
    """The protocol's definition as loops over one cropped motion, feet ``[L, 2, 3]``."""
    length = len(feet)
    speed = np.array(
        [[20 * np.hypot(*(feet[t + 1, f, [0, 2]] - feet[t, f, [0, 2]])) for t in range(length - 1)] for f in range(2)]
    )
    count = 0
    for t in range(length - 1):
        frame = False
        for f in range(2):
            average = sum(speed[f, k] for k in range(t - 2, t + 3) if 0 <= k < length - 1) / 5
            low = feet[t, f, 1] < 0.05 and feet[t + 1, f, 1] < 0.05
            frame |= low and speed[f, t] > 0.5 and average > 0.5
        count += frame
    return round(count / (length - 1), 4)


def test_skating_counts_what_slides() -> None:
    assert float(skating_ratio(sliding(0.0))) == 0.0
    assert float(skating_ratio(sliding(0.45))) == 0.0
    # at 0.7 m/s the first and last transition average (0.7 * 3) / 5 < 0.5 over the zeros beyond the ends
    assert float(skating_ratio(sliding(0.7))) == pytest.approx(37 / 39, abs=1e-4)
    lifted = sliding(2.0)
    assert float(skating_ratio(dataclasses.replace(lifted, joints=lifted.joints + torch.tensor([0, 0.06, 0])))) == 0.0


def test_skating_equals_the_definition_written_as_loops() -> None:
    generator = torch.Generator().manual_seed(3)
    steps = torch.randn(4, 60, 22, 3, generator=generator) * torch.tensor([0.04, 0.02, 0.04])
    joints = steps.cumsum(dim=1) * 0.5
    valid = torch.ones(4, 60, dtype=torch.bool)
    lengths = [60, 41, 60, 37]
    for sample, length in enumerate(lengths):
        valid[sample, length:] = False
        joints[sample, length:] = 1e3  # padding may hold anything
    ratios = skating_ratio(Motion(joints, valid))
    expected = [skating_by_hand(joints[s, :n][:, [10, 11]].double().numpy()) for s, n in enumerate(lengths)]
    assert any(0.02 < value < 0.98 for value in expected)
    assert ratios.tolist() == pytest.approx(expected, abs=2e-4)


def test_a_seam_ratio_compares_seams_with_all_else_whatever_the_pace() -> None:
    joints = torch.zeros(100, 22, 3, dtype=torch.float64)
    joints[:, :, 0] = 0.01 * torch.arange(100)[:, None] ** 2 / 2  # 0.01 m/frame^2 everywhere
    assert seam_ratio(Motion(joints), [2.5]) == pytest.approx(1.0, rel=1e-3)
    kicked = joints.clone()
    kicked[52, 21, 1] += 0.05  # one hand, 0.1 s behind the seam: a second difference of 0.1
    assert seam_ratio(Motion(kicked), [2.5]) == pytest.approx(10.0, rel=0.01)
    assert seam_ratio(Motion(3 * kicked), [2.5]) == pytest.approx(10.0, rel=0.01)
    assert seam_ratio(Motion(kicked), [4.0]) == pytest.approx(0.17, rel=0.05)  # over the 99th percentile
    assert math.isnan(seam_ratio(Motion(joints), [])) and math.isnan(seam_ratio(Motion(joints[:2]), [0.0]))


def test_max_acceleration_has_no_fps_and_ignores_padding() -> None:
    joints = standing(30)
    joints[:, 5, 0] += 0.5 * 0.01 * torch.arange(30.0) ** 2  # 0.01 m/frame^2
    motion = Motion(joints)
    assert float(max_acceleration(motion)) == pytest.approx(0.01, rel=1e-3)
    assert float(max_acceleration(dataclasses.replace(motion, fps=60.0))) == pytest.approx(0.01, rel=1e-3)
    valid = torch.ones(30, dtype=torch.bool)
    valid[20:] = False
    joints = joints.clone()
    joints[20:] = torch.nan
    assert float(max_acceleration(Motion(joints, valid))) == pytest.approx(0.01, rel=1e-3)


def test_bones_paths_and_soles() -> None:
    motion = sliding(1.0, 41).placed(Pose2D((3.0, 1.0 + DEFAULT_BODY.sole_offset, -2.0), heading=1.1))
    assert float(bone_length_drift(motion)) < 1e-5
    assert float(travelled(motion)) == pytest.approx(2.0, abs=1e-4)
    assert float(lowest_sole(motion, floor=1.0)) == pytest.approx(0.0, abs=1e-5)
    joints = motion.joints.clone()
    joints[7, 21, 1] += 0.03  # the right forearm points down: 3 cm up is 3 cm shorter
    assert float(bone_length_drift(dataclasses.replace(motion, joints=joints))) == pytest.approx(0.03, abs=1e-3)


def place(x: float, y: float = 0.0) -> Motion:
    return Motion(standing(4)).placed(Pose2D((x, y + DEFAULT_BODY.sole_offset, 0.0)))


def test_obstacles_and_floor_are_told_apart() -> None:
    # a wall whose face is at x = 1: the outermost part of a standing person is an elbow, wrist or palm
    boxed = Scene(primitives=[Box((1.5, 1.0, 0.0), (1.0, 2.0, 4.0))], floor=0.0)
    scorer = Scorer(boxed)
    samples, radii = DEFAULT_BODY.points(place(0.0))
    reach = float((samples[..., 0] + radii).max())
    far = scorer.depths(place(1.0 - reach - 0.05))
    assert far.obstacles.max() == 0.0 and far.floor.max() < 6e-3
    assert far.clearance.min() == pytest.approx(0.05, abs=3e-3)
    near = scorer.depths(place(1.0 - reach + 0.04))
    assert near.obstacles.max() == pytest.approx(0.04, abs=3e-3)
    sunk = scorer.depths(place(1.0 - reach - 0.05, y=-0.03))
    assert sunk.obstacles.max() == 0.0
    assert sunk.floor.max() - far.floor.max() == pytest.approx(0.03, abs=1e-4)


def test_meshes_and_primitives_give_the_same_depths() -> None:
    wall = Box((1.5, 1.0, 0.0), (1.0, 2.0, 4.0))
    analytic = Scorer(Scene(primitives=[wall], floor=0.0))
    meshed = Scorer(Scene(meshes=[wall.mesh()], floor=0.0, resolution=16, cache=None))
    for x in (0.3, 0.7, 0.9, 1.2):
        a, b = analytic.depths(place(x)), meshed.depths(place(x))
        assert b.obstacles == pytest.approx(a.obstacles, abs=1e-4)
        assert b.floor == pytest.approx(a.floor, abs=1e-4)


def test_what_is_baked_is_looked_at_near_the_body_alone() -> None:
    scene = Scene(meshes=[Box((1.5, 1.0, 0.0), (1.0, 2.0, 4.0)).mesh()], floor=0.0, resolution=64, cache=None)
    exact, baked = Scorer(scene), Scorer(scene, baked=True)
    asked: list[int] = []

    def counted(points: np.ndarray) -> np.ndarray:
        asked.append(len(points))
        return surface.unsigned_distance(points)

    ((name, surface),) = baked.surfaces
    vars(baked)["surfaces"] = ((name, SimpleNamespace(unsigned_distance=counted)),)
    for x in (-1.0, 0.3, 0.7, 0.9, 1.2):
        all_of_it, some = exact.depths(place(x)), baked.depths(place(x))
        near = all_of_it.rooms < 0.9 * BESIDE
        assert some.rooms[near] == pytest.approx(all_of_it.rooms[near], abs=1e-6)
        assert (some.rooms[~near] > 0.8 * BESIDE).all() and (some.rooms <= all_of_it.rooms + 0.02).all()
        assert some.obstacles == pytest.approx(all_of_it.obstacles, abs=1e-6)
    assert asked[0] < 0.3 * some.rooms.size


def test_moving_obstacles_are_met_when_they_come() -> None:
    ball = Sphere((0.0, 1.0, 3.0), 0.3, motion=Waypoints((0.0, 1.0), ((0.0, 1.0, 3.0), (0.0, 1.0, 0.0))))
    scorer = Scorer(Scene(primitives=[ball], floor=0.0))
    depths = scorer.depths(Motion(standing(21)).placed(Pose2D((0.0, DEFAULT_BODY.sole_offset, 0.0))))
    assert depths.obstacles[0] == 0.0
    assert depths.obstacles[-1] > 0.2
    figures = measure(Motion(standing(21)).placed(Pose2D((0.0, DEFAULT_BODY.sole_offset, 0.0))), scorer)
    assert figures["deepest_at_s"] == pytest.approx(1.0, abs=0.06)
    assert isinstance(figures["deepest_part"], str)


def test_objects_are_scored_at_the_time_of_each_frame() -> None:
    """A wall on a trajectory equals, frame by frame, a wall that stands where it is then."""
    wall = Box((1.5, 1.0, 0.0), (1.0, 2.0, 4.0))
    way = Trajectory((0.2, 0.8), ((0.8, 0.0, 0.0), (0.0, 0.0, 0.0)), headings=(0.3, 0.0))
    motion = dataclasses.replace(Motion(standing(11)).placed(Pose2D((0.9, DEFAULT_BODY.sole_offset, 0.0))), t0=0.3)
    for shape in (wall, wall.mesh()):
        thing = MovingObject(shape, way, cache=None)
        depths = Scorer(Scene(objects=[thing], floor=0.0)).depths(motion)
        assert depths.obstacles[0] == 0.0 and depths.obstacles[-1] > 0.05
        for frame in range(11):
            there = thing.mesh(0.3 + frame / 20)
            static = Scorer(Scene([there], floor=0.0, cache=None)).depths(place(0.9))
            assert depths.obstacles[frame] == pytest.approx(static.obstacles[0], abs=1e-6)
            assert depths.clearance[frame] == pytest.approx(static.clearance[0], abs=1e-6)


def test_padding_touches_nothing() -> None:
    scorer = Scorer(Scene(primitives=[Box((1.5, 1.0, 0.0), (1.0, 2.0, 4.0))], floor=0.0))
    motion = place(1.2)
    valid = torch.zeros_like(motion.valid)
    assert scorer.depths(dataclasses.replace(motion, valid=valid)).obstacles.max() == 0.0


def test_poses_are_compared_as_seen_from_the_pelvis() -> None:
    before = Motion(walk(40)[None])
    turned = Pose2D((3.0, 0.2, -1.0), 1.3).apply(before.joints)
    assert float(pose_change(before, Motion(turned))) == pytest.approx(0.0, abs=1e-5)
    raised = turned.clone()
    raised[:, :, 20, 1] += 0.22
    assert float(pose_change(before, Motion(raised))) == pytest.approx(0.01, rel=1e-4)  # one joint of 22
    valid = torch.ones(1, 40, dtype=torch.bool)
    valid[:, 20:] = False
    raised[:, 20:] = 9.0
    assert float(pose_change(before, Motion(raised, valid=valid))) == pytest.approx(0.01, rel=1e-4)


def closed_room(wall: float) -> Scene:
    """4 x 4 m without a ceiling, of walls that are so thick (m), on open ground."""
    across = [Box((s * (2 + wall / 2), 1.2, 0.0), (wall, 2.4, 4.4)) for s in (-1, 1)]
    return Scene(primitives=[*across, *(Box((0.0, 1.2, s * (2 + wall / 2)), (4.0, 2.4, wall)) for s in (-1, 1))])


@pytest.mark.parametrize("wall", [0.04, 0.2])
def test_who_goes_through_a_wall_is_as_deep_as_the_way_back_is_long(wall: float) -> None:
    """A statue that is pushed out of a room: deep from the first touch on, and ever deeper."""
    joints = standing(80)
    joints[..., 1] += DEFAULT_BODY.sole_offset
    joints[..., 0] += 4.0 * torch.arange(80)[:, None] / 79
    motion, scorer = Motion(joints), Scorer(closed_room(wall))
    depths = scorer.depths(motion)
    assert (depths.beyond[:30] == 0).all() and (depths.beyond[50:] > 0).all()
    farthest = float(joints[-1, :, 0].max())
    assert depths.beyond[-1] == pytest.approx(farthest - 2.0, abs=0.06)
    assert depths.obstacles[-1] == pytest.approx(farthest - 2.0, abs=0.2)  # and the radius of what is farthest
    deep = depths.obstacles > 0.01
    assert (np.diff(depths.obstacles[deep]) > 0).all() and deep[deep.argmax() :].all()
    assert depths.floor.max() < 0.005
    figures = measure(motion, scorer)
    assert figures["beyond_free_space_m"] == pytest.approx(depths.beyond.max())
    assert figures["deepest_penetration_m"] == pytest.approx(depths.obstacles.max())
    assert figures["deepest_part"] == scorer.part(int(depths.part[-1]))


def test_a_motion_is_at_home_where_it_begins() -> None:
    for scene in (closed_room(0.1), closed_room(0.1).reached_from((0.0, 0.0, 0.0))):
        scorer = Scorer(scene)
        for x in (0.0, 8.0):
            depths = scorer.depths(Motion(standing(3)).placed(Pose2D((x, DEFAULT_BODY.sole_offset, 0.0))))
            assert depths.beyond.max() == 0.0
            assert depths.obstacles.max() == 0.0
