"""The map onto rigid bones: what it gives, what it leaves alone, and that it can be differentiated twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st

from scenes.motion.bones import bone_lengths, rest_lengths, rest_pose
from scenes.motion.motion import Motion
from scenes.motion.rigid import on_bones, rigid, tree_of, turns
from scenes.motion.skeleton import HUMANML3D, Skeleton

LONE = Skeleton(("root",), (-1,), ((0.0, 0.0, 0.0),))
ARM = Skeleton(
    ("root", "a", "b", "c"), (-1, 0, 1, 2), ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.5, 0.0))
)
LINE = Skeleton(("root", "a", "b"), (-1, 0, 0), ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (-2.0, 0.0, 0.0)))
"""Two bones in a line don't tell how their joint turns, and so turn alone."""
TOUCHING = Skeleton(("root", "a", "b"), (-1, 0, 1), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.3, 0.0)))
"""A bone of no length."""
BEAST = Skeleton(
    ("root", "hip", "knee", "mast", "tail", "end", "left", "right"),
    (-1, 0, 1, 0, 0, 4, 3, 3),
    (
        (0.0, 0.0, 0.0), (0.3, -0.1, 0.0), (0.0, -0.6, 0.1), (0.0, 0.4, 0.2), (0.0, 0.0, -0.5), (0.0, -0.1, -0.5),
        (0.2, 0.1, 0.0), (-0.2, 0.3, 0.1),
    ),
)  # fmt: skip
SKELETONS = {"people": HUMANML3D, "lone": LONE, "arm": ARM, "line": LINE, "touching": TOUCHING, "beast": BEAST}


def free(skeleton: Skeleton, seed: int = 0, spread: float = 0.05, frames: int = 5) -> torch.Tensor:
    """The skeleton at rest, turned and put anywhere, with every joint off by some centimetres."""
    draw = torch.Generator().manual_seed(seed)
    noise = torch.randn(frames, len(skeleton.names), 3, generator=draw, dtype=torch.float64)
    return moved(rest_pose(skeleton).expand(frames, -1, 3), seed) + spread * noise


def moved(joints: torch.Tensor, seed: int) -> torch.Tensor:
    draw = torch.Generator().manual_seed(seed)
    turn = torch.linalg.qr(torch.randn(3, 3, generator=draw, dtype=torch.float64))[0]
    return joints @ (turn * torch.linalg.det(turn)) + torch.randn(3, generator=draw, dtype=torch.float64)


@pytest.mark.parametrize("name", SKELETONS)
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 999))
def test_bones_have_their_lengths_and_branches_their_shape(name: str, seed: int) -> None:
    skeleton = SKELETONS[name]
    motion = Motion(on_bones(free(skeleton, seed), skeleton), skeleton=skeleton)
    if skeleton.bones:
        assert float((bone_lengths(motion) - rest_lengths(motion)).abs().max()) < 1e-6
    rest = rest_pose(skeleton)
    for branch in tree_of(skeleton).branches:  # all that leave one joint keep their distances
        ends = [bone + 1 for bone in branch.bones]
        apart, wanted = torch.cdist(motion.joints[:, ends], motion.joints[:, ends]), torch.cdist(rest[ends], rest[ends])
        assert float((apart - wanted).abs().max()) < 1e-6


@pytest.mark.parametrize("name", SKELETONS)
def test_what_is_rigid_stays_as_it_is_and_all_is_after_one_map(name: str) -> None:
    skeleton = SKELETONS[name]
    at_rest = moved(rest_pose(skeleton), 3)
    assert float((on_bones(at_rest, skeleton) - at_rest).abs().max()) < 1e-9  # m
    once = on_bones(free(skeleton, 4), skeleton)
    assert float((on_bones(once, skeleton) - once).abs().max()) < 1e-6


def test_the_root_stays_and_bones_that_turn_alone_keep_their_directions() -> None:
    joints = free(HUMANML3D, 5)
    after = on_bones(joints, HUMANML3D)
    assert torch.equal(after[:, 0], joints[:, 0])
    together = {bone for branch in tree_of(HUMANML3D).branches for bone in branch.bones}
    assert together == {HUMANML3D.index(n) - 1 for n in (
        "left_hip", "right_hip", "spine1", "neck", "left_collar", "right_collar",
    )}  # fmt: skip
    for bone, (parent, child) in enumerate(HUMANML3D.bones):
        if bone not in together:
            was, now = joints[:, child] - joints[:, parent], after[:, child] - after[:, parent]
            assert float(torch.linalg.cross(was, now).norm(dim=-1).max()) < 1e-9
            assert float((was * now).sum(-1).min()) > 0


@pytest.mark.parametrize("name", SKELETONS)
def test_it_commutes_with_rigid_moves_and_acts_on_each_frame_alone(name: str) -> None:
    skeleton, joints = SKELETONS[name], free(SKELETONS[name], 6)
    after = on_bones(joints, skeleton)
    torch.testing.assert_close(on_bones(moved(joints, 7), skeleton), moved(after, 7))
    torch.testing.assert_close(on_bones(joints[2], skeleton), after[2])
    joints[3] = torch.nan
    kept = on_bones(joints, skeleton)
    assert torch.equal(kept[[0, 1, 2, 4]], after[[0, 1, 2, 4]]) and bool(kept[3].isnan().all())


def test_turns_carry_branches_to_where_the_map_puts_them() -> None:
    after = on_bones(free(BEAST, 8), BEAST)
    assert len(tree_of(BEAST).branches) == 2
    for branch in tree_of(BEAST).branches:
        bones = torch.stack([after[:, bone + 1] - after[:, branch.joint] for bone in branch.bones], dim=1)
        turn = turns(bones, branch)
        torch.testing.assert_close(turn @ turn.mT, torch.eye(3).double().expand_as(turn), atol=1e-6, rtol=0)
        assert float((torch.tensor(branch.offsets).double() @ turn.mT - bones).abs().max()) < 1e-6


@pytest.mark.parametrize("name", SKELETONS)
def test_derivatives_of_first_and_second_order_are_right_forwards_and_backwards(name: str) -> None:
    skeleton = SKELETONS[name]
    joints = free(skeleton, 9, frames=1).requires_grad_(True)
    assert torch.autograd.gradcheck(lambda x: on_bones(x, skeleton), joints, check_forward_ad=True)
    assert torch.autograd.gradgradcheck(lambda x: on_bones(x, skeleton), joints)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_bones_without_a_direction_give_numbers_and_gradients(dtype: torch.dtype) -> None:
    """All joints in one place, hips in one line with the spine, and one bone of nothing among sound ones."""
    lined = rest_pose(HUMANML3D).to(dtype)
    lined[:, 0] = 0.0
    lined[:, 2] = 0.0
    short = free(HUMANML3D, 10, frames=1)[0].to(dtype)
    short[20] = short[18]
    joints = torch.stack([torch.zeros(22, 3, dtype=dtype), lined, short]).requires_grad_(True)
    after = on_bones(joints, HUMANML3D)
    (gradient,) = torch.autograd.grad(after.square().sum(), joints)
    assert bool(after.isfinite().all()) and bool(gradient.isfinite().all())
    others = np.delete(np.arange(22), [20])
    after = after.detach()
    assert float((on_bones(after[2], HUMANML3D) - after[2])[others].abs().max()) < 1e-5


def test_a_motion_keeps_all_else_and_may_get_the_bones_of_another_skeleton() -> None:
    motion = Motion(free(HUMANML3D, 11).float(), fps=30.0, t0=2.0)
    larger = replace(HUMANML3D, offsets=tuple((1.2 * x, 1.2 * y, 1.2 * z) for x, y, z in HUMANML3D.offsets))
    got = rigid(motion, larger)
    assert (got.fps, got.t0, got.skeleton) == (30.0, 2.0, larger) and torch.equal(got.valid, motion.valid)
    torch.testing.assert_close(bone_lengths(got), 1.2 * bone_lengths(rigid(motion)))


def test_tables_are_made_where_the_joints_are() -> None:
    joints = free(ARM, 12)
    other = replace(ARM, names=("root", "d", "e", "f"))  # not looked up before
    with torch.device("meta"):
        assert on_bones(joints, other).device.type == "cpu"
