"""Rotations carry the body, turn with it, and never flip: through straight limbs, from frame to frame, in any tree."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st
from torch import Tensor

from scenectl.bench.studies.rotations import animated, still_turns
from scenes.motion.bones import rest_pose
from scenes.motion.kinematics import forward, local_rotations, orientations
from scenes.motion.motion import Motion
from scenes.motion.rigid import on_bones, rigid
from scenes.motion.rotations import about, angle, matrices
from scenes.motion.skeleton import HUMANML3D, Skeleton, with_lengths


def wild(frames: int = 12, batch: tuple[int, ...] = (), skeleton: Skeleton = HUMANML3D) -> Motion:
    """Rigid bodies whose bones point anywhere."""
    joints = torch.randn(*batch, frames, len(skeleton.names), 3, dtype=torch.float64)
    return Motion(on_bones(joints, skeleton), skeleton=skeleton)


def tree(seed: int) -> Skeleton:
    """Any tree, with names that say nothing."""
    draw = np.random.default_rng(seed)
    count = int(draw.integers(1, 12))
    parents = (-1, *(int(draw.integers(0, j)) for j in range(1, count)))
    offsets = draw.normal(size=(count, 3)) * (draw.random((count, 1)) < 0.9)
    return Skeleton(tuple(f"node {j}" for j in range(count)), parents, tuple((x, y, z) for x, y, z in offsets.tolist()))


def limb(bends: Tensor, plane: Tensor, side: str = "left", part: str = "arm") -> Motion:
    """A body in the T-pose one limb of which bends by angles (rad) in planes turned (rad) about its upper bone."""
    names = ("hip", "knee") if part == "leg" else ("shoulder", "elbow")
    rotations = torch.zeros(len(bends), 22, 4, dtype=torch.float64)
    rotations[..., 0] = 1.0
    upper, middle = HUMANML3D.indices([f"{side}_{name}" for name in names])
    twist, hinge = (1, 0) if part == "leg" else (0, 1)
    way = 1.0 if part == "leg" or side == "right" else -1.0
    rotations[:, upper, 0], rotations[:, upper, 1 + twist] = (plane / 2).cos(), (plane / 2).sin()
    rotations[:, middle, 0], rotations[:, middle, 1 + hinge] = (bends / 2).cos(), way * (bends / 2).sin()
    return Motion(forward(rotations, torch.zeros(len(bends), 3, dtype=torch.float64), HUMANML3D))


@pytest.mark.parametrize("names", [["head"], ["left_elbow", "pelvis"], ["spine2"], ["right_foot", "spine3"]])
def test_some_joints_are_turned_as_among_all(names: list[str]) -> None:
    motion = wild(batch=(2,))
    every = orientations(motion)[..., HUMANML3D.indices(names), :, :]
    assert torch.equal(orientations(motion, names), every)


def test_the_t_pose_is_not_turned_at_all() -> None:
    rest = Motion(rest_pose(HUMANML3D).expand(2, 5, -1, -1).clone())
    torch.testing.assert_close(orientations(rest), torch.eye(3, dtype=torch.float64).expand(2, 5, 22, 3, 3))
    none = torch.tensor([1.0, 0.0, 0.0, 0.0], dtype=torch.float64)
    torch.testing.assert_close(rest.rotations, none.expand(2, 5, 22, 4))


@pytest.mark.parametrize("batch", [(), (2,), (2, 1)])
def test_rotations_give_the_joints_back(batch: tuple[int, ...]) -> None:
    for motion in (wild(batch=batch), replace(m := wild(batch=batch), joints=m.joints.float())):
        back = forward(motion.rotations, motion.joints[..., 0, :], HUMANML3D)
        assert (back - motion.joints).abs().max() < 1e-5
        torch.testing.assert_close(motion.rotations.norm(dim=-1), torch.ones_like(motion.joints[..., 0]))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_any_tree_is_carried(seed: int) -> None:
    torch.manual_seed(seed)
    motion = wild(skeleton=tree(seed))
    back = forward(motion.rotations, motion.joints[..., 0, :], motion.skeleton)
    assert (back - motion.joints).abs().max() < 1e-4
    turned = orientations(motion)
    torch.testing.assert_close(turned @ turned.mT, torch.eye(3, dtype=torch.float64).expand_as(turned))


def test_a_body_of_other_lengths_is_carried() -> None:
    skeleton = with_lengths(HUMANML3D, HUMANML3D.bone_lengths * np.linspace(0.7, 1.3, 22))
    motion = rigid(wild(), skeleton)
    assert (forward(motion.rotations, motion.joints[:, 0], skeleton) - motion.joints).abs().max() < 1e-5


def test_the_body_turned_is_every_joint_turned() -> None:
    motion = wild()
    turn = about(1, torch.tensor(0.7).double()) @ about(0, torch.tensor(-1.9).double())
    moved = replace(motion, joints=motion.joints @ turn.mT + 3.0)
    torch.testing.assert_close(orientations(moved), turn @ orientations(motion))
    torch.testing.assert_close(matrices(moved.rotations)[:, 1:], matrices(motion.rotations)[:, 1:])


def test_the_gradient_is_the_functions() -> None:
    motion = wild(frames=3)
    for joint in range(22):

        def turned(joints: Tensor, joint: int = joint) -> Tensor:
            return orientations(Motion(joints))[..., joint, :, :]

        joints = motion.joints.clone().requires_grad_()
        assert torch.autograd.gradcheck(turned, joints, fast_mode=True)


def test_rotations_known_come_back_but_for_what_joints_leave_open() -> None:
    truth, motion = animated(400, seed=3)
    wrong = torch.rad2deg(angle(truth.mT @ orientations(motion))).median(dim=0).values
    for name, most in {"pelvis": 0.01, "spine3": 0.01, "hip": 1.0, "knee": 1.0, "shoulder": 3.0, "elbow": 3.0}.items():
        for joint in (j for j, full in enumerate(HUMANML3D.names) if full.endswith(name)):
            assert wrong[joint] < most, HUMANML3D.names[joint]


@pytest.mark.parametrize("part", ["leg", "arm"])
@pytest.mark.parametrize("side", ["left", "right"])
def test_knees_bend_backward_and_elbows_forward_as_hinges(side: str, part: str) -> None:
    motion = limb(torch.full((9,), 1.2).double(), torch.zeros(9).double(), side, part)
    end = motion.joint(f"{side}_{'ankle' if part == 'leg' else 'wrist'}")[..., 2]
    assert (end < -0.3).all() if part == "leg" else (end > 0.2).all()
    upper = HUMANML3D.index(f"{side}_{'hip' if part == 'leg' else 'shoulder'}")
    torch.testing.assert_close(orientations(motion)[:, upper], torch.eye(3, dtype=torch.float64).expand(9, 3, 3))


@pytest.mark.parametrize("part", ["leg", "arm"])
@settings(max_examples=25, deadline=None)
@given(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2), st.floats(-0.15, 0.05))  # bent the wrong way by up to 9 degrees
def test_nothing_flips_while_a_limb_goes_straight_and_bends_elsewhere(
    part: str, before: float, after: float, least: float
) -> None:
    way = torch.linspace(-1, 1, 41, dtype=torch.float64)
    plane = torch.where(way < 0, before, after)
    motion = limb(least + 0.8 * way.square(), plane, part=part)
    upper = HUMANML3D.index("left_hip" if part == "leg" else "left_shoulder")
    turned = orientations(motion)[:, upper]
    assert torch.rad2deg(angle(turned[1:].mT @ turned[:-1])).max() < 30


@pytest.mark.parametrize("part", ["leg", "arm"])
def test_nothing_flips_while_a_limb_folds_beyond_what_a_person_can(part: str) -> None:
    motion = limb(torch.linspace(0.5, math.pi + 0.2, 41).double(), torch.full((41,), 0.4).double(), part=part)
    turned = orientations(motion)
    assert torch.rad2deg(angle(turned[1:].mT @ turned[:-1])).max() < 30


def test_a_straight_limb_shaken_by_noise_does_not_turn() -> None:
    motion = limb(0.02 * torch.randn(200).double(), 3 * torch.randn(200).double(), part="leg")
    turned = orientations(motion)[:, HUMANML3D.index("left_hip")]
    assert torch.rad2deg(angle(turned[1:].mT @ turned[:-1])).max() < 2


def test_quaternions_go_on_without_a_change_of_sign() -> None:
    spin = about(1, torch.linspace(0, 5 * math.pi, 90).double())
    motion = Motion(rest_pose(HUMANML3D) @ spin.mT)
    q = local_rotations(motion)
    assert ((q[1:] * q[:-1]).sum(-1) > 0.9).all()
    assert (q[0, :, 0] >= 0).all()
    assert (q[:, 0, 0] < 0).any()  # it went all the way round


def test_padding_says_nothing() -> None:
    motion = animated(60, seed=1)[1]
    valid = torch.arange(60) < 40
    torn = motion.joints.clone()
    torn[40:] = torch.randn(20, 22, 3, dtype=torch.float64)
    short = orientations(replace(motion, joints=motion.joints[:40], valid=valid[:40]))
    torch.testing.assert_close(orientations(replace(motion, joints=torn, valid=valid))[:40], short)


def test_a_turn_while_nothing_moves_is_seen() -> None:
    bent = torch.full((10,), 1.0).double()
    plane = torch.where(torch.arange(10) < 5, 0.0, 1.5).double()
    shoulder = HUMANML3D.index("left_shoulder")
    assert still_turns(limb(bent, plane)).max() < 1  # the wrist goes round with it
    tiny = with_lengths(HUMANML3D, HUMANML3D.bone_lengths * 0.02)
    assert still_turns(rigid(limb(bent, plane), tiny))[:, shoulder].max() > 60
