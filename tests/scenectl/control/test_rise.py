"""Ground that rises under a motion: whole bodies on it, products with it, and no rise where no height is stated."""

from __future__ import annotations

import math

import torch

from objectives import Objective, Term
from scenectl.control.rise import Rise
from scenectl.generators.steps import MappedStep
from scenes.motion.bones import bone_lengths
from scenes.motion.skeleton import FEET
from tests.objectives.cases import wandering
from tests.scenectl.control.products import assert_derivatives_and_adjoint
from tests.scenectl.control.test_guide import step

SLOPE = {"path": [[0.0, 1.0, -9.0], [0.0, 4.0, 1.0], [0.0, -2.0, 9.0]], "height": 0.95}


def rise(**given: object) -> Rise:
    found = Rise.of(Objective((Term("follow_path", SLOPE | given),)))
    assert found is not None
    return found


def test_bodies_are_lifted_whole_onto_the_higher_of_the_grounds_under_their_feet() -> None:
    motion = wandering(2)
    risen = rise(path=[[0.0, 1.0, -50.0], [0.0, 21.0, 50.0]]).under(motion)  # 0.2 m up each metre of z
    lift = risen.joints - motion.joints
    assert lift[..., ::2].abs().max() == 0
    torch.testing.assert_close(lift[..., 1], lift[..., :1, 1].expand(lift.shape[:-1]))
    below = 0.2 * (motion.select(FEET)[..., 2].amax(-1) + 50.0) - lift[..., 0, 1]
    assert below.min() > -1e-6 and below.max() <= 0.05 * math.log(2) + 1e-6
    torch.testing.assert_close(bone_lengths(risen), bone_lengths(motion))


def test_without_a_height_over_a_path_nothing_rises() -> None:
    assert Rise.of(Objective((Term("follow_path", {"path": [[0, 0], [0, 1]]}), Term("foot_contact")))) is None


def test_products_of_a_risen_step_are_derivatives_and_adjoint() -> None:
    s = MappedStep(step(exact=True), rise(begin=0.0, end=2.0).under)
    assert_derivatives_and_adjoint(s)
    torch.testing.assert_close(s.take(torch.tensor([1])).motion.joints, s.motion.joints[1:2])
