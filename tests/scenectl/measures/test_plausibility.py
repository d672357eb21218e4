"""Plausibility figures on motions whose faults are put there on purpose."""

from __future__ import annotations

import pytest
import torch

from scenectl.data.features import canonicalise
from scenectl.measures.plausibility import (
    FIGURES,
    floating_share,
    floor_penetration,
    jerk,
    joint_limit_share,
    plausibility,
    self_penetration,
)
from scenes.motion.motion import Motion
from tests.scenectl.small import walk
from tests.scenectl.tiny import statue


def still(frames: int = 60) -> torch.Tensor:
    return statue().expand(frames, 22, 3).clone()


def test_a_statue_has_no_fault_and_a_batch_equals_a_loop() -> None:
    for name, value in plausibility(Motion(still())).items():
        assert float(value) == pytest.approx(0.0, abs=1e-6), name
    pair = torch.stack([canonicalise(walk(60)), still()])
    both = plausibility(Motion(pair))
    assert tuple(both) == FIGURES
    for i in range(2):
        for name, value in plausibility(Motion(pair[i])).items():
            torch.testing.assert_close(both[name][i], value, atol=1e-5, rtol=1e-4)


def test_padding_does_not_count() -> None:
    joints = canonicalise(walk(60))
    wild = torch.cat([joints, 5 * torch.randn(20, 22, 3, generator=torch.Generator().manual_seed(0)) - 3])
    padded = plausibility(Motion(wild, torch.arange(80) < 60))
    for name, value in plausibility(Motion(joints)).items():
        torch.testing.assert_close(padded[name], value, atol=1e-5, rtol=1e-4)


def test_jerk_of_a_cubic() -> None:
    t = torch.arange(30, dtype=torch.float64)[:, None, None] / 20
    assert float(jerk(Motion(statue().double() + t**3 * torch.tensor([2.0, 0, 0])))) == pytest.approx(12.0, rel=1e-6)


def test_floating_is_longer_than_a_jump() -> None:
    joints = still(60)
    joints[20:32, :, 1] += 0.4  # 0.6 s: a jump
    assert float(floating_share(Motion(joints))) == 0.0
    joints[20:40, :, 1] = still(20)[..., 1] + 0.4
    assert float(floating_share(Motion(joints))) == pytest.approx(20 / 60)


def test_floor_penetration_is_the_deepest() -> None:
    joints = still()
    joints[30, :, 1] -= 0.07
    assert float(floor_penetration(Motion(joints))) == pytest.approx(0.07, abs=1e-6)


def test_knees_bend_one_way() -> None:
    joints = still(40)
    bent = joints.clone()
    bent[:10, 4] += torch.tensor([0.0, 0.0, 0.2])  # a knee to the front
    assert float(joint_limit_share(Motion(bent))) == 0.0
    bent[:10, 4] = joints[:10, 4] - torch.tensor([0.0, 0.0, 0.2])
    assert float(joint_limit_share(Motion(bent))) == pytest.approx(10 / 40)
    folded = joints.clone()
    folded[:5, 20] = folded[:5, 16] + 0.01  # a wrist in its shoulder
    assert float(joint_limit_share(Motion(folded))) == pytest.approx(5 / 40)


def test_a_hand_in_the_chest_is_deep() -> None:
    joints = still(10)
    assert float(self_penetration(Motion(joints))) == 0.0
    joints[:5, 21] = joints[:5, 9]
    joints[:5, 19] = joints[:5, 9] + torch.tensor([-0.2, 0.0, 0.1])
    assert float(self_penetration(Motion(joints))) > 0.02
