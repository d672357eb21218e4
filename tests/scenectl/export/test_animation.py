"""Animations: what is rigid stays, other rates pass through the frames, axes turn all alike."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from scenectl.data.corpus import load_motions
from scenectl.export.animation import Animation
from scenectl.export.names import PRESETS, named
from scenes.errors import UserError
from scenes.mesh.scale import TO_Y_UP
from scenes.motion.motion import Motion
from scenes.motion.skeleton import FEET, HUMANML3D
from tests.scenectl.export.moving import lengths, moving

RATES = (20.0, 30.0, 60.0)


def naive(a: np.ndarray, b: np.ndarray, share: float) -> np.ndarray:
    """Slerp as textbooks have it."""
    cosine = float(a @ b)
    b, cosine = (b, cosine) if cosine >= 0 else (-b, -cosine)
    angle = np.arccos(min(cosine, 1.0))
    if angle < 1e-9:
        return a
    mixed: np.ndarray = (np.sin((1 - share) * angle) * a + np.sin(share * angle) * b) / np.sin(angle)
    return mixed


@pytest.mark.parametrize("fps", RATES)
def test_what_is_rigid_stays(fps: float) -> None:
    motion = moving(seed=int(fps), fps=fps)
    animation, moved = Animation.of(motion)
    assert moved == 0 and animation.fps == fps
    np.testing.assert_allclose(animation.joints, motion.joints.numpy(), atol=1e-6)


def test_what_is_not_rigid_is_put_on_bones_and_by_how_much_is_told() -> None:
    motion = moving()
    bent = replace(motion, joints=motion.joints + 0.01 * torch.sin(torch.arange(66.0)).reshape(22, 3))
    bent.joints[::2, 7] += 0.02
    animation, moved = Animation.of(bent)
    away = np.linalg.norm(animation.joints - bent.joints.numpy(), axis=-1)
    assert moved == pytest.approx(away.max(), abs=1e-5) and 0.001 < moved < 0.05
    assert np.ptp(lengths(animation.joints, animation.skeleton.parents), axis=0).max() < 1e-6


def test_batches_and_nothing_are_refused_and_padding_is_left_out() -> None:
    motion = moving(10)
    valid = torch.arange(10) < 7
    assert Animation.of(replace(motion, valid=valid))[0].frames == 7
    with pytest.raises(UserError, match="without a valid frame"):
        Animation.of(replace(motion, valid=torch.zeros(10, dtype=torch.bool)))
    with pytest.raises(UserError, match="an animation is one motion"):
        Animation.of(Motion(motion.joints[None], skeleton=motion.skeleton))


@pytest.mark.parametrize("preset", ["humanml", "unreal"])
@pytest.mark.parametrize(("fps", "step"), [(40.0, 2), (60.0, 3)])
def test_other_rates_pass_through_the_frames(fps: float, step: int, preset: str) -> None:
    animation = named(Animation.of(moving())[0], preset)
    finer = animation.resampled(fps)
    assert finer.fps == fps and finer.frames == step * (animation.frames - 1) + 1
    np.testing.assert_allclose(finer.joints[::step], animation.joints, atol=1e-9)
    np.testing.assert_allclose(np.abs((finer.rotations[::step] * animation.rotations).sum(-1)), 1, atol=1e-9)
    back = finer.resampled(20.0)
    np.testing.assert_allclose(back.joints, animation.joints, atol=1e-9)
    np.testing.assert_allclose(back.rotations, animation.rotations, atol=1e-6)


def test_rotations_between_frames_are_slerps_and_roots_cubic() -> None:
    animation = Animation.of(moving(seed=3))[0]
    finer = animation.resampled(60.0)
    for frame, joint in ((0, 0), (7, 4), (20, 16), (38, 17)):
        for share, at in ((1 / 3, 3 * frame + 1), (2 / 3, 3 * frame + 2)):
            wanted = naive(animation.rotations[frame, joint], animation.rotations[frame + 1, joint], share)
            assert abs(wanted @ finer.rotations[at, joint]) == pytest.approx(1, abs=1e-12)
    times = finer.times[:, None]
    curve = np.concatenate([0.3 * times**3 - times**2, 1 + 0.1 * times, times**2 - 0.1 * times**3], axis=1)
    cubic = replace(animation, roots=curve[::3]).resampled(60.0)
    np.testing.assert_allclose(cubic.roots, curve, atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(fps=st.floats(5, 240), frames=st.integers(2, 60), seed=st.integers(0, 50))
def test_at_any_rate_bones_keep_their_lengths_and_the_motion_its_duration(fps: float, frames: int, seed: int) -> None:
    animation = named(Animation.of(moving(frames, seed))[0], "unreal")
    other = animation.resampled(fps)
    assert other.fps == fps and np.isfinite(other.joints).all()
    assert -1e-6 <= animation.times[-1] - other.times[-1] < 1 / fps + 1e-9
    free = np.array(other.skeleton.parents[1:]) > 0  # the pelvis moves against a root on the floor
    found = lengths(other.joints, other.skeleton.parents)[:, free]
    np.testing.assert_allclose(found - other.skeleton.bone_lengths[1:][free], 0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(other.rotations, axis=-1), 1, atol=1e-9)
    assert ((other.rotations[1:] * other.rotations[:-1]).sum(-1) >= 0).all()


def test_people_do_not_sink_at_other_rates(shared: Path) -> None:
    """Of every 4th recorded test clip at 60 frames a second, feet are at most 8 mm under where they were lowest before.

    Nor do cubic roots overshoot: they are at most 5 mm under the lower one of the frames around.
    """
    for clip in load_motions(shared / "data" / "motions", ("test",))[::40]:
        animation = Animation.of(Motion(clip.joints))[0]
        finer, feet = animation.resampled(60.0), HUMANML3D.indices(("left_ankle", "right_ankle", *FEET))
        assert finer.joints[:, feet, 1].min() > animation.joints[:, feet, 1].min() - 0.008
        lower = np.minimum(animation.roots[:-1, 1], animation.roots[1:, 1])
        assert (finer.roots[:-1, 1].reshape(-1, 3) > lower[:, None] - 0.005).all()


@pytest.mark.parametrize("fps", [0.0, -1.0, 1e9, float("nan")])
def test_rates_that_are_none_are_a_sentence(fps: float) -> None:
    with pytest.raises(UserError, match="frames a second cannot be written"):
        Animation.of(moving(5))[0].resampled(fps)


@pytest.mark.parametrize("preset", PRESETS)
def test_in_place_the_body_turns_and_rises_and_stays(preset: str) -> None:
    animation = Animation.of(moving())[0]
    still = named(animation, preset).in_place()
    pelvis = still.joints[:, still.ours[0]]
    np.testing.assert_allclose(pelvis[:, [0, 2]], np.broadcast_to(animation.roots[0, [0, 2]], (40, 2)), atol=1e-9)
    np.testing.assert_allclose(pelvis[:, 1], animation.roots[:, 1], atol=1e-9)
    again = named(animation.in_place(), preset)
    np.testing.assert_allclose(again.joints[:, again.ours], still.joints[:, still.ours], atol=1e-9)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_another_axis_is_up_for_motion_and_t_pose_alike(up: str, preset: str) -> None:
    animation = named(Animation.of(moving())[0], preset)
    turned = animation.turned(up)
    np.testing.assert_allclose(turned.joints @ TO_Y_UP[up].T, animation.joints, atol=1e-9)
    rest = np.array(turned.skeleton.offsets) @ TO_Y_UP[up].T
    np.testing.assert_allclose(rest, np.array(animation.skeleton.offsets), atol=1e-12)


def test_world_rotations_carry_the_t_pose() -> None:
    animation = named(Animation.of(moving())[0], "soma")
    for joint, parent in list(enumerate(animation.skeleton.parents))[2:]:
        turn = Rotation.from_quat(animation.orientations[:, parent], scalar_first=True)
        bone = turn.apply(animation.skeleton.offsets[joint])
        np.testing.assert_allclose(animation.joints[:, parent] + bone, animation.joints[:, joint], atol=1e-9)
    assert Animation.of(moving())[0].size == pytest.approx(animation.size)
