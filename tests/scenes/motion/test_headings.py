"""Headings are angles about +y from +z to +x, and turns by them are rotations."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from scenes.motion.bones import rest_pose
from scenes.motion.frames import about_y
from scenes.motion.headings import across, heading, heading_across, heading_of, rotation_about_y, turned
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.rotations import rotated
from scenes.motion.skeleton import HUMANML3D

ANGLES = torch.linspace(-3.1, 3.1, 25, dtype=torch.float64)


def person(angle: float = 0.0, frames: int = 3) -> Motion:
    joints = Pose2D(heading=angle).apply(rest_pose(HUMANML3D))
    return Motion(joints.expand(2, frames, -1, -1))


def test_forward_is_plus_z_and_left_is_plus_x() -> None:
    assert float(heading_of(torch.tensor([0.0, 5.0, 2.0]))) == 0.0
    assert float(heading_of(torch.tensor([3.0, 0.0, 0.0]))) == pytest.approx(math.pi / 2)
    assert float(heading_across(torch.tensor([1.0, 0.0, 0.0]))) == 0.0  # facing +z, +x is to the left
    assert float(heading_across(torch.tensor([0.0, 0.0, -1.0]))) == pytest.approx(math.pi / 2)


def test_what_faces_forward_has_its_left_a_quarter_turn_on() -> None:
    forward = torch.randn(50, 3, dtype=torch.float64)
    left = turned(forward, torch.tensor(math.pi / 2))
    torch.testing.assert_close(heading_across(left), heading_of(forward), atol=1e-7, rtol=0)


def test_a_turned_vector_has_a_heading_that_is_more_by_the_angle() -> None:
    forward = torch.tensor([0.0, 1.0, 2.0], dtype=torch.float64).expand(25, 3)
    torch.testing.assert_close(heading_of(turned(forward, ANGLES)), ANGLES)
    torch.testing.assert_close(turned(turned(forward, ANGLES), -ANGLES), forward)


def test_turning_is_the_rotation_in_any_batch() -> None:
    vectors = torch.randn(4, 25, 7, 3, dtype=torch.float64)
    matrix = rotation_about_y(ANGLES)
    torch.testing.assert_close(turned(vectors, ANGLES[:, None]), rotated(matrix[:, None], vectors))
    torch.testing.assert_close(turned(vectors[0, 3], ANGLES[3]), turned(vectors, ANGLES[:, None])[0, 3])
    torch.testing.assert_close(turned(vectors[0, 0, 0], ANGLES), rotated(matrix, vectors[0, 0, 0]))


def test_matrices_of_one_number_and_of_many_are_the_same_rotation() -> None:
    many = rotation_about_y(ANGLES).numpy()
    for angle, matrix in zip(ANGLES.tolist(), many, strict=True):
        assert np.allclose(about_y(angle), matrix, atol=1e-15)
    assert np.allclose(many @ many.swapaxes(1, 2), np.eye(3)) and np.allclose(np.linalg.det(many), 1)


@pytest.mark.parametrize("angle", [-2.5, -0.3, 0.0, 1.0, 3.0])
def test_a_placed_person_has_the_heading_of_the_place(angle: float) -> None:
    motion = person(angle)
    for parts in (("hip", "shoulder"), ("hip",)):
        torch.testing.assert_close(heading(motion, parts), torch.full((2, 3), angle, dtype=torch.float64))


def test_across_sums_what_lies_between_the_sides() -> None:
    motion = person()
    hips = motion.joint("left_hip") - motion.joint("right_hip")
    shoulders = motion.joint("left_shoulder") - motion.joint("right_shoulder")
    torch.testing.assert_close(across(motion), hips + shoulders)
    torch.testing.assert_close(across(motion, ("shoulder",)), shoulders)
