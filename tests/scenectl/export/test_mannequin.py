"""The mannequin: closed, as its capsules are, in proportion on other bones, and whole in poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from hypothesis import given, settings, strategies as st

from scenectl.export.animation import Animation
from scenectl.export.mannequin import FILE, Mannequin
from scenectl.export.mannequin.make import BLEND, SOLE, tubes
from scenes.motion.bones import rest_pose
from scenes.motion.motion import Motion
from scenes.motion.skeleton import FEET, HUMANML3D, size_of, with_lengths

MANNEQUIN = Mannequin.bundled()
LEFT, RIGHT = ([k for k, name in enumerate(HUMANML3D.names) if name.startswith(side)] for side in ("left", "right"))


def solid(mannequin: Mannequin, vertices: np.ndarray | None = None) -> trimesh.Trimesh:
    return trimesh.Trimesh(mannequin.vertices if vertices is None else vertices, mannequin.faces, process=False)


def posed(mannequin: Mannequin, **turns: tuple[float, float, float]) -> np.ndarray:
    """Vertices with joints turned by Euler angles x, y, z in degrees: by frames, not by our kinematics."""
    rest = rest_pose(mannequin.skeleton).numpy()
    frames = np.tile(np.eye(4), (22, 1, 1))
    for joint, parent in enumerate(HUMANML3D.parents):
        local = trimesh.transformations.euler_matrix(*np.radians(turns.get(HUMANML3D.names[joint], (0, 0, 0))))
        local[:3, 3] = rest[joint] - rest[max(parent, 0)]
        frames[joint] = (frames[parent] if parent >= 0 else np.eye(4)) @ local
    frames = frames @ np.array([trimesh.transformations.translation_matrix(-place) for place in rest])
    held = (frames[mannequin.joints] * mannequin.weights[..., None, None]).sum(axis=1)
    vertices: np.ndarray = (held[:, :3, :3] @ mannequin.vertices[..., None])[..., 0] + held[:, :3, 3]
    return vertices


def test_it_is_one_closed_skin_of_few_triangles() -> None:
    mesh = solid(MANNEQUIN)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.body_count == 1 and mesh.euler_number == 2
    assert 0.05 < mesh.volume < 0.08  # of a person of 50 to 80 kg
    assert 4500 <= len(mesh.faces) <= 5500
    assert mesh.area_faces.min() > 0
    assert FILE.stat().st_size < 300_000


def test_four_joints_at_most_carry_a_vertex_and_their_shares_sum_to_one() -> None:
    assert MANNEQUIN.joints.shape == MANNEQUIN.weights.shape == (len(MANNEQUIN.vertices), 4)
    assert MANNEQUIN.weights.min() >= 0 and set(MANNEQUIN.joints.ravel()) <= set(range(22))
    np.testing.assert_allclose(MANNEQUIN.weights.sum(axis=1), 1.0, atol=1e-12)
    assert (np.diff(np.sort(MANNEQUIN.joints, axis=1), axis=1) > 0).all(), "a joint is named twice"


def test_no_side_carries_the_other() -> None:
    rest = rest_pose(HUMANML3D).numpy()
    for mine, sign in ((LEFT, 1), (RIGHT, -1)):
        share = np.where(np.isin(MANNEQUIN.joints, mine), MANNEQUIN.weights, 0.0).sum(axis=1)
        assert share[sign * MANNEQUIN.vertices[:, 0] < -0.06].max() < 0.1
    nearest = np.linalg.norm(MANNEQUIN.vertices[:, None] - rest[MANNEQUIN.joints], axis=-1)
    assert np.where(MANNEQUIN.weights > 0.05, nearest, 0.0).max() < 0.6  # nor a hand the hip


def test_the_skin_is_that_of_the_tubes() -> None:
    distance = np.min([tube.nearest(MANNEQUIN.vertices)[0] for tube in tubes()], axis=0)
    above = MANNEQUIN.vertices[:, 1] > MANNEQUIN.vertices[:, 1].min() + 0.01  # the soles are cut
    assert np.abs(distance[above]).max() < 0.75 * BLEND
    assert abs(float(np.median(distance))) < 0.005


def test_soles_are_level_and_under_the_feet() -> None:
    feet = rest_pose(HUMANML3D)[HUMANML3D.indices(FEET), 1].numpy()
    for joint, height in zip(HUMANML3D.indices(FEET), feet, strict=True):
        mine = (MANNEQUIN.joints == joint) & (MANNEQUIN.weights > 0.5)
        assert MANNEQUIN.vertices[mine.any(axis=1), 1].min() == pytest.approx(height - SOLE, abs=0.008)
    assert (MANNEQUIN.vertices[:, 1] < feet.min() - SOLE + 0.002).sum() > 20  # they lie on the ground, not at a point


@given(st.floats(0.4, 1.6))
@settings(max_examples=20, deadline=None)
def test_larger_people_get_a_larger_one(by: float) -> None:
    larger = MANNEQUIN.on(HUMANML3D.scaled(by))
    np.testing.assert_allclose(larger.vertices, by * MANNEQUIN.vertices, atol=1e-9)
    np.testing.assert_allclose(larger.normals, MANNEQUIN.normals, atol=1e-6)


@given(st.lists(st.floats(0.7, 1.4), min_size=22, max_size=22))
@settings(max_examples=20, deadline=None)
def test_any_proportions_get_a_whole_one(ratios: list[float]) -> None:
    """Bones longer and shorter: the skin stays closed, keeps its outside, goes along each bone, and comes back."""
    other = with_lengths(HUMANML3D, HUMANML3D.bone_lengths * ratios)
    mannequin = MANNEQUIN.on(other)
    mesh = solid(mannequin)
    size = size_of(other)
    assert mesh.is_watertight and mesh.volume > 0.02 * size**3
    rest, before = rest_pose(other).numpy(), rest_pose(HUMANML3D).numpy()
    for joint in (15, 20, 21):  # what one joint alone carries is only larger or smaller
        alone = ((MANNEQUIN.joints == joint) & (MANNEQUIN.weights > 0.999)).any(axis=1)
        assert alone.any()
        wanted = rest[joint] + size * (MANNEQUIN.vertices[alone] - before[joint])
        np.testing.assert_allclose(mannequin.vertices[alone], wanted, atol=2e-3)


@pytest.mark.parametrize(
    "turns",
    [
        {"left_hip": (-90, 0, 0), "right_hip": (-90, 0, 0), "left_knee": (90, 0, 0), "right_knee": (90, 0, 0)},
        {"left_hip": (-120, 0, 20), "right_hip": (-120, 0, -20), "left_knee": (140, 0, 0), "right_knee": (140, 0, 0)},
        {"left_shoulder": (0, 0, 60), "right_shoulder": (0, 0, -60), "left_collar": (0, 0, 20)},
        {"left_shoulder": (0, 0, -75), "right_shoulder": (0, 0, 75)},
        {"left_shoulder": (90, 0, -75), "left_elbow": (0, -120, 0), "head": (0, 50, 0), "spine2": (0, 20, 0)},
    ],
    ids=["sitting", "squatting", "arms up", "arms down", "turned"],
)
def test_it_keeps_its_volume_and_tears_nowhere(turns: dict[str, tuple[float, float, float]]) -> None:
    mesh, rest = solid(MANNEQUIN, posed(MANNEQUIN, **turns)), solid(MANNEQUIN)
    assert mesh.volume > 0.9 * rest.volume
    longer = mesh.edges_unique_length - rest.edges_unique_length
    assert longer.max() < 0.07, "an edge became a spike"


def test_joints_of_another_skeleton_carry_it() -> None:
    """An animation whose skeleton has more joints than ours, in another order, gets the one of its proportions."""
    tall = HUMANML3D.scaled(1.2)
    animation, _ = Animation.of(Motion(rest_pose(tall)[None], fps=20.0, skeleton=tall))
    plain = Mannequin.of(animation)
    offsets = ((0.1, 0.0, 0.2), *((x, y, z) for x, y, z in tall.offsets))
    more = replace(tall, names=("root", *tall.names), parents=(-1, *(p + 1 for p in tall.parents)), offsets=offsets)
    other = replace(animation, skeleton=more, ours=animation.ours + 1)
    np.testing.assert_allclose(Mannequin.of(other).vertices, plain.vertices, atol=1e-12)
    assert torch.equal(torch.from_numpy(plain.joints), torch.from_numpy(MANNEQUIN.joints))
