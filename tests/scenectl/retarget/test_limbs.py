"""Legs of two bones: what can be reached is, bones keep their length, knees stay before, one frame is as in a batch."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from scenectl.retarget.characters.limbs import bent, between, eased, lowered


def legs(seed: int, frames: int = 20) -> tuple[np.ndarray, ...]:
    """Hips, knees, ankles, hinges: knees bend by 5 to 120 degrees about the hinge, legs point anywhere downward."""
    rng = np.random.default_rng(seed)
    hip = rng.normal(size=(frames, 3))
    down = np.array([0.0, -1.0, 0.0]) + 0.5 * rng.normal(size=(frames, 3))
    down /= np.linalg.norm(down, axis=-1, keepdims=True)
    hinge = np.cross(down, rng.normal(size=(frames, 3)))
    hinge /= np.linalg.norm(hinge, axis=-1, keepdims=True)
    angle = rng.uniform(0.1, 2.0, size=(frames, 1))
    shin = np.cos(angle) * down + np.sin(angle) * np.cross(hinge, down)
    knee = hip + 0.4 * down
    return hip, knee, knee + 0.45 * shin, hinge


def moved(hip: np.ndarray, knee: np.ndarray, ankle: np.ndarray, turns: tuple[np.ndarray, np.ndarray]) -> tuple:
    thigh = hip + np.einsum("tij,tj->ti", turns[0], knee - hip)
    return thigh, thigh + np.einsum("tij,tj->ti", turns[1], ankle - knee)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_what_is_reachable_is_reached_and_the_rest_as_nearly_as_can_be(seed: int) -> None:
    hip, knee, ankle, hinge = legs(seed)
    rng = np.random.default_rng(seed + 1)
    way = ankle - hip + 0.15 * rng.normal(size=ankle.shape)
    new_knee, new_ankle = moved(hip, knee, ankle, bent(hip, knee, ankle, hinge, hip + way))
    far = np.linalg.norm(way, axis=-1)
    nearest = hip + way * (far.clip(0.05, 0.85) / far)[:, None]
    np.testing.assert_allclose(new_ankle, nearest, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(new_knee - hip, axis=-1), 0.4, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(new_ankle - new_knee, axis=-1), 0.45, atol=1e-12)


def test_what_is_in_place_is_not_turned() -> None:
    hip, knee, ankle, hinge = legs(3)
    for turn in bent(hip, knee, ankle, hinge, ankle):
        np.testing.assert_allclose(turn, np.tile(np.eye(3), (20, 1, 1)), atol=2e-4)


def test_knees_that_bend_forward_come_back_behind_and_others_stay() -> None:
    hip, knee, ankle, hinge = legs(4)
    for sign in (1, -1):  # seen from the other side of the hinge all of them bend the wrong way
        new_knee, new_ankle = moved(hip, knee, ankle, bent(hip, knee, ankle, sign * hinge, ankle))
        bend = (np.cross(new_knee - hip, new_ankle - new_knee) * sign * hinge).sum(-1)
        assert (bend > 0).all()
        np.testing.assert_allclose(new_ankle, ankle, atol=1e-6)


def test_a_batch_is_its_frames() -> None:
    hip, knee, ankle, hinge = legs(5)
    target = ankle + 0.05
    together = bent(hip, knee, ankle, hinge, target)
    for t in range(20):
        alone = bent(*(a[t : t + 1] for a in (hip, knee, ankle, hinge, target)))
        np.testing.assert_allclose(alone, [turn[t : t + 1] for turn in together], atol=1e-12)


def test_straight_knees_pass_from_one_side_to_the_other_without_a_jump() -> None:
    hinge = np.tile([1.0, 0.0, 0.0], (101, 1))
    angle = np.linspace(-0.2, 0.2, 101)
    hip, knee = np.zeros((101, 3)), np.tile([0.0, -0.4, 0.0], (101, 1))
    ankle = knee + 0.45 * np.stack([0.02 * np.ones(101), -np.cos(angle), -np.sin(angle)], axis=-1)
    new_knee, _ = moved(hip, knee, ankle, bent(hip, knee, ankle, hinge, ankle))
    assert np.linalg.norm(np.diff(new_knee, axis=0), axis=-1).max() < 0.003


def test_hips_go_down_smoothly_by_as_much_as_a_leg_is_too_short() -> None:
    hips, targets = np.zeros((1, 60, 3)), np.tile([0.0, -0.7, 0.0], (1, 60, 1))
    targets[0, 30] = [0.3, -0.8, 0.0]
    down = lowered(hips, targets, np.full((1, 60), 0.8), 5)
    assert down[30] >= 0.8 - np.sqrt(0.8**2 - 0.3**2) - 1e-12
    assert np.abs(np.diff(down, n=2)).max() < 0.012 and down[0] == down[-1] == 0
    targets[0, 30] = [5.0, -0.8, 0.0]  # nothing helps
    assert lowered(hips, targets, np.full((1, 60), 0.8), 5).max() == 0


def test_corrections_hold_fade_and_go_from_one_to_the_next() -> None:
    by, held = np.zeros((40, 3)), np.zeros(40, dtype=bool)
    by[10:15], by[17:20] = 1.0, 3.0
    held[10:15] = held[17:20] = True
    found = eased(by, held, 4)[:, 0]
    assert (found[10:15] == 1).all() and (found[17:20] == 3).all() and (found[[5, 6, 23, 24]] == 0).all()
    assert 1 < found[15] < found[16] < 3 and found[7] < found[8] < found[9] < 1
    assert not eased(by, np.zeros(40, dtype=bool), 4).any()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_the_smallest_rotation_takes_one_direction_to_the_other(seed: int) -> None:
    a, b = np.random.default_rng(seed).normal(size=(2, 5, 3))
    turn = between(a, b)
    unit = b / np.linalg.norm(b, axis=-1, keepdims=True) * np.linalg.norm(a, axis=-1, keepdims=True)
    np.testing.assert_allclose(np.einsum("tij,tj->ti", turn, a), unit, atol=1e-6)
    assert np.linalg.det(turn) == pytest.approx(1.0, abs=1e-6)
