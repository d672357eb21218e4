"""Rotations in space: unit quaternions give rotation matrices, and the one between two directions is the smallest."""

from __future__ import annotations

import numpy as np
import torch

from scenes.motion.frames import rotations
from scenes.motion.rotations import matrices, rotated, rotation_between


def unit(*shape: int) -> torch.Tensor:
    vectors = torch.randn(*shape, dtype=torch.float64)
    return vectors / vectors.norm(dim=-1, keepdim=True)


def test_a_quaternion_and_its_negative_are_one_rotation() -> None:
    q = unit(40, 4)
    m = matrices(q)
    torch.testing.assert_close(m @ m.mT, torch.eye(3, dtype=torch.float64).expand(40, 3, 3))
    torch.testing.assert_close(torch.linalg.det(m), torch.ones(40, dtype=torch.float64))
    torch.testing.assert_close(matrices(-q), m)
    assert np.array_equal(rotations(q.numpy()), m.numpy())


def test_quaternions_turn_by_twice_the_angle_of_their_scalar() -> None:
    half = torch.tensor(0.35, dtype=torch.float64)
    about_x = torch.stack([half.cos(), half.sin(), torch.zeros_like(half), torch.zeros_like(half)])
    y = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    expected = torch.stack([torch.zeros_like(half), (2 * half).cos(), (2 * half).sin()])
    torch.testing.assert_close(rotated(matrices(about_x), y), expected)


def test_the_rotation_between_directions_takes_one_to_the_other_and_is_the_smallest() -> None:
    a, b = 3 * unit(60, 3), unit(60, 3)
    between = rotation_between(a, b)
    torch.testing.assert_close(rotated(between, a) / 3, b)
    trace = between.diagonal(dim1=-2, dim2=-1).sum(-1)
    torch.testing.assert_close(((trace - 1) / 2).clamp(-1, 1).acos(), (a * b / 3).sum(-1).clamp(-1, 1).acos())


def test_opposed_directions_are_half_a_turn_apart() -> None:
    a = unit(30, 3)
    between = rotation_between(a, -a)
    torch.testing.assert_close(rotated(between, a), -a)
    torch.testing.assert_close(torch.linalg.det(between), torch.ones(30, dtype=torch.float64))


def test_between_no_direction_and_any_there_is_some_rotation() -> None:
    a, none = unit(4, 3), torch.zeros(4, 3, dtype=torch.float64)
    for between in (rotation_between(none, a), rotation_between(a, none), rotation_between(none, none)):
        assert between.isfinite().all()


def test_batches_broadcast() -> None:
    m, v = matrices(unit(5, 1, 4)), unit(7, 3)
    assert rotated(m, v).shape == (5, 7, 3)
    torch.testing.assert_close(rotated(m, v)[2, 4], m[2, 0] @ v[4])
