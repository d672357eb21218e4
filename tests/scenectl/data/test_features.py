"""HumanML3D's 263 features: the published clip, the layout, and what must hold for any motion."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from scenectl.data import features as f
from scenes.errors import UserError
from scenes.motion.headings import rotation_about_y
from scenes.motion.rigid import on_bones
from scenes.motion.skeleton import HUMANML3D

AGREED = 90
"""Rows of the reference that a conversion of the published joints can reach: the source's last frame is not published,
and the smoothed heading near the end depends on it."""


@pytest.fixture(scope="session")
def reference(shared: Path) -> tuple[Tensor, Tensor]:
    """Joints ``[T, 22, 3]`` and features ``[T - 1, 263]`` of clip 012314 as published, in float64.

    The published joints were themselves recovered from features, so they lack the source's last frame: as many
    frames as there are rows.
    """
    folder = shared / "data" / "humanml3d"
    joints = torch.from_numpy(np.load(folder / "012314_new_joints.npy")).double()
    rows = torch.from_numpy(np.load(folder / "012314_new_joint_vecs.npy")).double()
    return joints, rows


def random_clip(frames: int = 60, seed: int = 0) -> Tensor:
    """A smooth wandering person on the uniform skeleton, float64: bones that swing about their rest directions."""
    generator = torch.Generator().manual_seed(seed)
    rest = torch.tensor(HUMANML3D.offsets, dtype=torch.float64)
    time = torch.arange(frames, dtype=torch.float64)[:, None, None] / 20
    phase, rate = (torch.rand(1, f.JOINTS, 3, generator=generator, dtype=torch.float64) * 6 for _ in range(2))
    swing = 0.3 * torch.sin(phase + rate * time)
    joints = torch.zeros(frames, f.JOINTS, 3, dtype=torch.float64)
    angle = 1.5 * torch.sin(time[:, 0, 0])
    turn = rotation_about_y(angle)
    joints[:, 0] = torch.stack([time[:, 0, 0], 0.9 + 0.05 * torch.sin(3 * time[:, 0, 0]), 0.5 * angle], -1)
    for joint in range(1, f.JOINTS):
        length = rest[joint].norm()
        direction = rest[joint] / length + swing[:, joint]
        bone = direction / direction.norm(dim=-1, keepdim=True) * length
        joints[:, joint] = joints[:, HUMANML3D.parents[joint]] + (turn @ bone[..., None]).squeeze(-1)
    return joints


def rest_pose() -> Tensor:
    joints = torch.zeros(f.JOINTS, 3, dtype=torch.float64)
    for joint in range(1, f.JOINTS):
        offset = joints.new_tensor(HUMANML3D.offsets[joint])
        joints[joint] = joints[HUMANML3D.parents[joint]] + offset
    return joints


def turned(joints: Tensor, angle: float) -> Tensor:
    return joints @ rotation_about_y(joints.new_tensor(angle)).T


def test_reference_features_become_the_published_joints(reference: tuple[Tensor, Tensor]) -> None:
    joints, rows = reference
    assert (f.features_to_joints(rows) - joints).abs().max() < 2e-6


def test_published_joints_become_the_reference_features(reference: tuple[Tensor, Tensor]) -> None:
    joints, rows = reference
    ours = f.joints_to_features(joints)
    difference = (ours[:AGREED] - rows[:AGREED]).abs()
    assert difference[:, f.ROTATIONS].max() < 1e-5
    difference[:, f.ROTATIONS] = 0
    assert difference.max() < 1e-6


@pytest.mark.parametrize("part", ["YAW", "ROOT_VELOCITY", "ROOT_HEIGHT", "POSITIONS", "VELOCITIES", "CONTACTS"])
def test_each_part_sits_where_the_layout_says(reference: tuple[Tensor, Tensor], part: str) -> None:
    # recomputed from the protocol's definitions, not from our conversion
    joints, rows = reference
    where = {"YAW": (0, 1), "ROOT_VELOCITY": (1, 3), "ROOT_HEIGHT": (3, 4), "POSITIONS": (4, 67),
             "VELOCITIES": (193, 259), "CONTACTS": (259, 263)}[part]  # fmt: skip
    assert getattr(f, part) == slice(*where)
    half = torch.cat([torch.zeros(1, dtype=rows.dtype), rows[:-1, 0].cumsum(0)])
    c, s = torch.cos(2 * half), torch.sin(2 * half)  # into the heading frame: rotation by +2A

    def into(rotation: slice, v: Tensor) -> Tensor:
        cos, sin = c[rotation].reshape(-1, *[1] * (v.ndim - 2)), s[rotation].reshape(-1, *[1] * (v.ndim - 2))
        return torch.stack([v[..., 0] * cos + v[..., 2] * sin, v[..., 1], -v[..., 0] * sin + v[..., 2] * cos], -1)

    steps = joints[1:] - joints[:-1]
    ground = joints[:, :1] * joints.new_tensor([1.0, 0.0, 1.0])
    feet = [7, 10, 8, 11]
    expected = {
        "YAW": rows[:, :1],
        "ROOT_VELOCITY": into(slice(1, None), steps[:, 0])[:, [0, 2]],
        "ROOT_HEIGHT": joints[:, 0, 1:2],
        "POSITIONS": into(slice(None), joints - ground)[:, 1:].flatten(1),
        "VELOCITIES": into(slice(0, -1), steps).flatten(1),
        "CONTACTS": (steps[:, feet].square().sum(-1) < 0.002).double(),
    }[part]
    assert (rows[:AGREED, slice(*where)] - expected[:AGREED]).abs().max() < 2e-6
    assert (f.joints_to_features(joints)[:AGREED, slice(*where)] - expected[:AGREED]).abs().max() < 2e-6


def test_groups_cover_every_feature_once() -> None:
    covered = [i for group in f.GROUPS for i in range(group.start, group.stop)]
    assert covered == list(range(f.FEATURES))


def test_reference_bones_are_the_uniform_skeleton(reference: tuple[Tensor, Tensor]) -> None:
    joints, _ = reference
    for joint, parent in enumerate(HUMANML3D.parents[1:], start=1):
        lengths = (joints[:, joint] - joints[:, parent]).norm(dim=-1)
        assert (lengths - HUMANML3D.bone_lengths[joint]).abs().max() < 1e-4
    assert (f.to_uniform_skeleton(joints) - joints).abs().max() < 1e-3


def test_standard_deviations_of_the_data_set_fit_the_groups(shared: Path) -> None:
    # Std.npy is averaged inside each group, which pins down the layout independently of any clip
    std = np.load(shared / "data" / "humanml3d" / "Std.npy")
    values = [0.012826, 0.016927, 0.153766, 0.122244, 0.299692, 0.019470, 0.355933]
    for group, value in zip(f.GROUPS, values, strict=True):
        assert np.allclose(std[group], value, atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_round_trip_returns_all_but_the_last_frame(seed: int) -> None:
    clip = f.canonicalise(random_clip(seed=seed))
    back = f.features_to_joints(f.joints_to_features(clip))
    assert back.shape == (59, 22, 3)
    assert (back - clip[:-1]).abs().max() < 1e-10
    single = f.features_to_joints(f.joints_to_features(clip.float()))
    assert (single - clip[:-1]).abs().max() < 1e-5


def test_round_trip_of_real_clips(shared: Path) -> None:
    with np.load(shared / "data" / "motions" / "motions_20fps.npz") as data:
        ends = np.concatenate([[0], np.cumsum(data["length"])])
        scale, delta = float(data["quant"]), data["delta"]
    for clip in (0, 57, 611, 2000):
        steps = delta[:, :, ends[clip] : ends[clip + 1]].transpose(2, 0, 1).astype(np.int64)
        joints = torch.from_numpy(steps.cumsum(0) * scale).float()
        joints[:, 1:] += joints[:, :1]
        joints = f.canonicalise(f.to_uniform_skeleton(joints))
        back = f.features_to_joints(f.joints_to_features(joints))
        # converted in single precision, a path of several metres sums many small steps
        assert (back - joints[:-1]).abs().max() < 1e-5, clip


def test_uniform_skeleton_sets_lengths_keeps_directions_and_is_idempotent() -> None:
    clip = random_clip()
    stretched = clip * 1.1 + 0.02 * torch.randn(clip.shape, dtype=clip.dtype)
    uniform = f.to_uniform_skeleton(stretched)
    for joint, parent in enumerate(HUMANML3D.parents[1:], start=1):
        bone, was = uniform[:, joint] - uniform[:, parent], stretched[:, joint] - stretched[:, parent]
        assert torch.allclose(bone.norm(dim=-1), bone.new_tensor(HUMANML3D.bone_lengths[joint]).expand(len(bone)))
        assert torch.allclose(torch.cosine_similarity(bone, was, dim=-1), torch.ones(len(bone), dtype=bone.dtype))
    assert torch.allclose(f.to_uniform_skeleton(uniform), uniform)


def test_recovery_has_the_right_gradient() -> None:
    rows = f.joints_to_features(random_clip(6)).requires_grad_()
    assert torch.autograd.gradcheck(f.features_to_joints, (rows,))


def test_mirror_twice_is_the_same_and_once_swaps_sides() -> None:
    clip = random_clip()
    assert torch.equal(f.mirror(f.mirror(clip)), clip)
    left, right = HUMANML3D.index("left_wrist"), HUMANML3D.index("right_wrist")
    assert torch.equal(f.mirror(clip)[:, left, 1:], clip[:, right, 1:])
    assert torch.equal(f.mirror(clip)[:, left, 0], -clip[:, right, 0])


def test_mirrored_person_turns_the_other_way() -> None:
    # sideways and turning parts flip sign, heights and forward motion stay
    clip = f.canonicalise(random_clip())
    rows, mirrored = f.joints_to_features(clip), f.joints_to_features(f.mirror(clip))
    assert torch.allclose(mirrored[:, 0], -rows[:, 0], atol=1e-9)
    assert torch.allclose(mirrored[:, 1], -rows[:, 1], atol=1e-9)
    assert torch.allclose(mirrored[:, 2:4], rows[:, 2:4], atol=1e-9)
    assert torch.equal(mirrored[:, f.CONTACTS], rows[:, f.CONTACTS][:, [2, 3, 0, 1]])


@pytest.mark.parametrize("angle", [0.3, math.pi / 2, math.pi, -2.5])
def test_features_do_not_depend_on_heading_or_place(angle: float) -> None:
    clip = random_clip()
    moved = turned(clip, angle) + torch.tensor([3.0, 0.7, -8.0], dtype=clip.dtype)
    assert (f.joints_to_features(moved) - f.joints_to_features(clip)).abs().max() < 1e-9


def test_canonical_clips_start_at_the_origin_facing_forward() -> None:
    clip = f.canonicalise(turned(random_clip(), 1.1) + 2.0)
    assert clip[..., 1].min() == 0
    assert clip[0, 0, [0, 2]].abs().max() < 1e-12
    across = clip[0, 2] - clip[0, 1] + clip[0, 17] - clip[0, 16]
    assert across[0] < 0 and abs(across[2]) < 1e-12  # the right side lies at -x
    assert torch.allclose(f.canonicalise(clip), clip)


def test_turning_left_and_walking_have_the_stated_signs() -> None:
    frames = 240  # away from the ends, where smoothing bends the heading
    time = torch.arange(frames, dtype=torch.float64)
    pose = rest_pose()  # untwisted: hips and shoulders agree on where it faces
    spin = 0.02 * time  # +y turns +z towards +x, the person's left
    clip = (rotation_about_y(spin)[:, None] @ pose[None, ..., None]).squeeze(-1)
    assert torch.allclose(f.joints_to_features(clip)[110:130, 0], torch.tensor(-0.01, dtype=torch.float64), atol=1e-6)
    walk = pose + torch.stack([0 * time, 0 * time, 0.05 * time], -1)[:, None]
    rows = f.joints_to_features(walk)
    assert torch.allclose(rows[:, 1:3], rows.new_tensor([0.0, 0.05]), atol=1e-9)
    assert not rows[:, f.CONTACTS].any()  # 5 cm a frame is not contact; 4 cm is
    slow = f.joints_to_features(pose + 0.8 * (walk - pose))
    assert slow[:, f.CONTACTS].all()


def test_recovery_of_a_batch_equals_a_loop() -> None:
    rows = torch.stack([f.joints_to_features(random_clip(seed=seed)) for seed in range(6)])
    batch = f.features_to_joints(rows.reshape(2, 3, *rows.shape[1:])).reshape(6, -1, 22, 3)
    for row, joints in zip(rows, batch, strict=True):
        assert torch.allclose(f.features_to_joints(row), joints, atol=1e-12)


def test_rotations_are_orthonormal_pairs() -> None:
    pairs = f.joints_to_features(random_clip())[:, f.ROTATIONS].unflatten(-1, (21, 2, 3))
    gram = pairs @ pairs.transpose(-1, -2)
    assert torch.allclose(gram, torch.eye(2, dtype=gram.dtype).expand_as(gram), atol=1e-6)


def test_clips_without_features_are_refused() -> None:
    with pytest.raises(UserError, match="at least 2"):
        f.joints_to_features(random_clip(1))
    broken = random_clip()
    broken[3, 4, 1] = math.nan
    with pytest.raises(UserError, match="not finite"):
        f.joints_to_features(broken)


def test_features_on_the_body_are_those_of_its_bones() -> None:
    """Directions and headings stay, feet keep their mean height, displacements follow joints, and once is enough."""
    features = f.joints_to_features(random_clip())
    placed = f.on_body(features)
    before, after = f.features_to_joints(features), f.features_to_joints(placed)
    torch.testing.assert_close(on_bones(after, HUMANML3D), after, atol=1e-5, rtol=0)
    chain = [(16, 18), (18, 20), (1, 4), (4, 7), (12, 15)]
    for parent, child in chain:
        torch.testing.assert_close(
            F.normalize(after[:, child] - after[:, parent], dim=-1),
            F.normalize(before[:, child] - before[:, parent], dim=-1),
        )
    torch.testing.assert_close(after[:, [10, 11], 1].mean(), before[:, [10, 11], 1].mean())
    torch.testing.assert_close(after[:, 0, [0, 2]], before[:, 0, [0, 2]])
    turn = rotation_about_y(torch.nn.functional.pad(2 * features[:-1, 0].cumsum(0), (1, 0)))
    steps = (turn[:-1, None] @ (after[1:] - after[:-1])[..., None]).squeeze(-1)
    torch.testing.assert_close(placed[:-1, f.VELOCITIES].unflatten(-1, (22, 3)), steps, atol=1e-9, rtol=0)
    torch.testing.assert_close(f.on_body(placed), placed, atol=1e-5, rtol=0)


def test_only_the_map_is_between_decoded_features_and_a_body() -> None:
    features = f.joints_to_features(random_clip())
    torch.testing.assert_close(f.body_joints(features), on_bones(f.features_to_joints(features), HUMANML3D))
