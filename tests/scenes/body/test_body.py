"""The proxy body covers its bones, stands on the floor, is linear in the joints and says where its radii come from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st

from scenes.body.body import DEFAULT_BODY, SHORTEST, SOURCE, STATURE, STRETCH, TALLEST, ProxyBody
from scenes.errors import UserError
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D

BODY = DEFAULT_BODY


def random_pose(seed: int, stretch: float) -> torch.Tensor:
    """Joints [22, 3] with bones in random directions, up to `stretch` times their length at rest."""
    rng = np.random.default_rng(seed)
    joints = np.zeros((22, 3))
    for parent, child in HUMANML3D.bones:
        direction = rng.normal(size=3)
        length = HUMANML3D.bone_lengths[child] * rng.uniform(0.8, stretch)
        joints[child] = joints[parent] + length * direction / np.linalg.norm(direction)
    return torch.from_numpy(joints)


def rest_pose() -> torch.Tensor:
    joints = np.zeros((22, 3))
    for parent, child in HUMANML3D.bones:
        joints[child] = joints[parent] + np.array(HUMANML3D.offsets[child])
    return torch.from_numpy(joints)


def reference(shared: Path) -> torch.Tensor:
    return torch.from_numpy(np.load(shared / "data/humanml3d/012314_new_joints.npy", allow_pickle=False)).double()


def test_every_joint_has_a_sphere_and_every_bone_a_capsule() -> None:
    assert [s.joint for s in BODY.spheres[:22]] == list(range(22))
    assert tuple((c.a, c.b) for c in BODY.capsules) == HUMANML3D.bones
    assert 60 <= BODY.count <= 110
    assert BODY.radii().min() > 0.02 and BODY.radii().max() < 0.15


@pytest.mark.parametrize("seed", range(10))
def test_gaps_between_samples_never_exceed_the_radius(seed: int) -> None:
    joints = random_pose(seed, STRETCH)
    points = BODY.points_of(joints)
    for capsule in BODY.capsules:
        name = f"{HUMANML3D.names[capsule.a]}-{HUMANML3D.names[capsule.b]}"
        inside = [points[m] for m, part in enumerate(BODY.parts) if part == name]
        chain = torch.stack([joints[capsule.a], *inside, joints[capsule.b]])
        gaps = chain.diff(dim=0).norm(dim=-1)
        assert gaps.max() <= capsule.radius + 1e-9, name


def test_the_same_holds_on_real_motion(shared: Path) -> None:
    joints = reference(shared)[::10]
    points = BODY.points_of(joints)
    for capsule in BODY.capsules:
        name = f"{HUMANML3D.names[capsule.a]}-{HUMANML3D.names[capsule.b]}"
        inside = [points[:, m] for m, part in enumerate(BODY.parts) if part == name]
        chain = torch.stack([joints[:, capsule.a], *inside, joints[:, capsule.b]])
        assert chain.diff(dim=0).norm(dim=-1).max() <= capsule.radius


def test_left_and_right_are_mirror_images() -> None:
    radius = {row["part"]: row["radius_m"] for row in BODY.table()}
    assert all(radius[part] == radius[str(part).replace("left", "right")] for part in radius)


def test_weights_are_affine_so_a_moved_person_moves_whole() -> None:
    joints = random_pose(0, 1.0)
    shift = torch.tensor([3.0, -1.0, 2.0], dtype=torch.float64)
    assert torch.allclose(BODY.points_of(joints + shift), BODY.points_of(joints) + shift, atol=1e-12)


def test_batches_equal_loops_and_gradients_are_exact() -> None:
    joints = torch.stack([torch.stack([random_pose(i + 3 * k, 1.0) for i in range(3)]) for k in range(2)])
    points = BODY.points_of(joints)
    assert points.shape == (2, 3, BODY.count, 3)
    assert torch.allclose(points[1, 2], BODY.points_of(joints[1, 2]), atol=1e-12)
    assert torch.autograd.gradcheck(BODY.points_of, (random_pose(1, 1.0).requires_grad_(),))


def test_points_of_a_motion_come_with_radii_in_its_type() -> None:
    motion = Motion(torch.stack([rest_pose()] * 4).float()[None])
    points, radius = BODY.points(motion)
    assert points.shape == (1, 4, BODY.count, 3)
    assert radius.shape == (BODY.count,) and radius.dtype == torch.float32


def test_soles_touch_the_floor_and_nothing_lies_below(shared: Path) -> None:
    joints = reference(shared)
    points = BODY.points_of(joints)
    below = points[..., 1] - BODY.radii(points) + BODY.sole_offset  # heights of the lowest points above the floor
    assert joints[:, [10, 11], 1].min() == pytest.approx(0.0, abs=1e-6)
    assert below.min() == pytest.approx(0.0, abs=1e-6)  # the foot spheres touch
    others = [m for m, part in enumerate(BODY.parts) if part not in ("left_foot", "right_foot")]
    assert below[:, others].min() > 0


def test_the_crown_lies_where_a_skull_ends() -> None:
    joints = rest_pose()
    neck, head = HUMANML3D.indices(["neck", "head"])
    joints[head] = joints[neck] + torch.tensor([0.0, 0.103, 0.0], dtype=torch.float64)  # looking straight ahead
    points = BODY.points_of(joints)
    top = (points[:, 1] + BODY.radii(points)).max() - joints[head, 1]
    assert 0.14 < top < 0.2  # the joint is at the base of the skull, some 4 cm below the ear; ear to crown is 13 cm


def test_masks_drop_what_the_exempted_joints_own() -> None:
    mask = BODY.mask(["right_wrist"])
    dropped = {part for part, kept in zip(BODY.parts, mask, strict=True) if not kept}
    assert dropped == {"right_wrist", "right_palm", "right_elbow-right_wrist"}
    assert BODY.mask().all() and BODY.mask([]).all()
    assert set(BODY.owners) == set(HUMANML3D.names)


def test_unknown_joints_and_foreign_skeletons_are_refused_in_one_sentence() -> None:
    with pytest.raises(UserError, match="did you mean 'right_wrist'"):
        BODY.mask(["right_rist"])
    other = replace(HUMANML3D, names=tuple(f"j{i}" for i in range(22)))
    with pytest.raises(UserError, match="retarget the motion"):
        BODY.points(Motion(torch.zeros(2, 22, 3), skeleton=other))


def test_the_table_names_its_source() -> None:
    rows = BODY.table()
    assert len(rows) == len(BODY.spheres) + len(BODY.capsules)
    assert all(row["origin"] for row in rows)
    assert "ANSUR II" in SOURCE and BODY.source == SOURCE
    assert ProxyBody.human() == BODY


def test_segments_are_the_samples_whole() -> None:
    """Every sample lies on a segment of its own radius, and every segment goes from sample to sample."""
    joints = torch.randn(2, 5, 22, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    motion = Motion(joints)
    a, b, radius, owners = BODY.segments(motion)
    assert a.shape == b.shape == (2, 5, len(radius), 3) and len(owners) == len(radius)
    points, radii = BODY.points(motion)
    for m in range(BODY.count):
        p, way = points[..., m : m + 1, :], b - a
        share = ((p - a) * way).sum(-1) / way.square().sum(-1).clamp_min(1e-12)
        away = (p - a - share.clamp(0, 1)[..., None] * way).norm(dim=-1)
        assert ((away < 1e-9) & (radius == radii[m])).any(-1).all()
    bones = a.shape[-2] - len(BODY.spheres)
    assert 10 < bones <= len(BODY.capsules)
    samples = points[..., None, :, :]  # and it ends at samples: where joints carry thinner spheres, it stops before
    for ends in (a, b):
        assert ((ends[..., None, :] - samples).norm(dim=-1).amin(-1) < 1e-9).all()


@settings(deadline=None, max_examples=20)
@given(st.floats(SHORTEST, TALLEST))
def test_people_of_other_heights_are_in_proportion(height: float) -> None:
    body, ratio = ProxyBody.human(height), height / STATURE
    assert body.height == pytest.approx(height, abs=1e-3) and body.size == pytest.approx(ratio)
    assert body.breadth == pytest.approx(ratio * BODY.breadth)
    np.testing.assert_allclose(body.skeleton.bone_lengths, ratio * BODY.skeleton.bone_lengths)
    joints = rest_pose()
    torch.testing.assert_close(body.points_of(ratio * joints), ratio * BODY.points_of(joints))
    torch.testing.assert_close(body.radii(), ratio * BODY.radii())
    assert body.sole_offset == pytest.approx(ratio * BODY.sole_offset)


def test_the_default_body_is_that_of_the_default_height_and_others_are_refused() -> None:
    assert ProxyBody.human(STATURE) == BODY and BODY.size == 1.0
    for height in (1.19, 2.11, 0.0, -1.7, float("nan"), float("inf")):
        with pytest.raises(UserError, match=r"height is .*; give 1\.2 to 2\.1 m"):
            ProxyBody.human(height)
