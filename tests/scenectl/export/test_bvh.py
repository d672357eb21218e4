"""BVH as bvhio, which did not write it, and our own reader see it."""

from __future__ import annotations

from pathlib import Path

import bvhio
import numpy as np
import pytest

from scenectl.data.formats.bvh import convert_bvh, read_bvh
from scenectl.data.formats.people import UNITS
from scenectl.export.animation import Animation
from scenectl.export.export import export
from scenectl.export.names import PRESETS, named
from scenes.mesh.scale import TO_Y_UP
from scenes.motion.motion import Motion
from tests.scenectl.export.moving import lengths, moving
from tests.scenectl.small import walk


def seen(path: Path, frame: int | None = None) -> tuple[list[str], np.ndarray]:
    """Names and world places of all joints as bvhio has them, in a frame or at rest."""
    root = bvhio.readAsHierarchy(str(path))
    root = root.loadRestPose() if frame is None else root.loadPose(frame)
    joints = [joint for joint, _, _ in root.layout()]
    return [joint.Name for joint in joints], np.array([list(joint.PositionWorld) for joint in joints])


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(
    ("fps", "up", "unit"), [(20.0, "y", None), (30.0, "z", "m"), (60.0, "y", "in"), (60.0, "z", "cm")]
)
def test_another_reader_finds_joints_within_a_millimetre(
    preset: str, fps: float, up: str, unit: str | None, tmp_path: Path
) -> None:
    motion = moving(24, seed=int(fps))
    export(motion, tmp_path / "x.bvh", fps=fps, names=preset, up=up, unit=unit)
    made = named(Animation.of(motion)[0].resampled(fps), preset)
    head = bvhio.readAsBvh(str(tmp_path / "x.bvh"))
    assert head.FrameCount == made.frames and head.FrameTime == pytest.approx(1 / fps, rel=1e-9)
    metres = UNITS[unit or "cm"]
    for frame in range(0, made.frames, 7):
        names, places = seen(tmp_path / "x.bvh", frame)
        order = [made.skeleton.index(name) for name in names]
        assert sorted(order) == list(range(len(made.skeleton.names)))
        back = (places * metres @ TO_Y_UP[up].T)[np.argsort(order)]
        off = np.linalg.norm(back - made.joints[frame], axis=-1)
        assert off[made.ours].max() < 1e-3 and (preset in ("unreal", "soma") or off.max() < 1e-3)
        if frame % (fps / 20) == 0:
            original = motion.joints[round(frame * 20 / fps)].numpy()
            assert np.linalg.norm(back[made.ours] - original, axis=-1).max() < 1e-3


@pytest.mark.parametrize("preset", PRESETS)
def test_at_rest_the_body_is_the_t_pose(preset: str, tmp_path: Path) -> None:
    export(moving(5), tmp_path / "x.bvh", names=preset)
    names, places = seen(tmp_path / "x.bvh")
    skeleton = named(Animation.of(moving(5))[0], preset).skeleton
    rest = np.zeros((len(names), 3))
    for parent, joint in skeleton.bones:
        rest[joint] = rest[parent] + skeleton.offsets[joint]
    np.testing.assert_allclose(places / 100, rest[[skeleton.index(name) for name in names]], atol=1e-5)


def test_the_file_is_as_tools_expect_it(tmp_path: Path) -> None:
    export(moving(5), tmp_path / "x.bvh", names="mixamo")
    text = (tmp_path / "x.bvh").read_text()
    channels = [line.split()[1:] for line in text.splitlines() if "CHANNELS" in line]
    turns = ["Zrotation", "Xrotation", "Yrotation"]
    assert channels == [["6", "Xposition", "Yposition", "Zposition", *turns], *[["3", *turns]] * 21]
    assert text.count("End Site") == 5 and "e-" not in text.split("MOTION")[1]
    ends = [line.split()[1:] for line in text.split("End Site")[1:] for line in line.splitlines()[2:3]]
    assert all(np.linalg.norm([float(number) for number in end]) > 3 for end in ends)  # cm: bones that can be seen


def test_all_frames_come_back_through_our_reader(tmp_path: Path) -> None:
    motion = Motion(walk(60), fps=30.0)
    for preset in PRESETS:
        export(motion, tmp_path / "x.bvh", names=preset, unit="cm")
        clip = convert_bvh(read_bvh(tmp_path / "x.bvh"), fps=None)
        made = Animation.of(motion)[0]
        assert clip.unit == "cm" and clip.motion.fps == 30.0
        off = np.linalg.norm(clip.motion.joints.numpy() - made.joints, axis=-1)
        ends = [0, 1, 2, 4, 5, 7, 8, 10, 11, 12, *range(13, 22)]  # spines of other counts are placed along them
        assert off[:, ends].max() < 1e-4
        bones = lengths(clip.motion.joints.numpy()[:, ends[:9]], (-1, 0, 0, 1, 2, 3, 4, 5, 6))
        assert np.ptp(bones, axis=0).max() < 1e-4


def test_angles_turn_on_where_a_thigh_passes_a_right_angle(tmp_path: Path) -> None:
    """There z and y turn about one axis, and of the two ways to write a rotation one jumps by half a turn."""
    motion = moving(400, seed=1, fps=120.0)
    export(motion, tmp_path / "x.bvh")
    values = read_bvh(tmp_path / "x.bvh").values[:, 3:].reshape(400, -1, 3)
    assert np.abs(np.diff(values, axis=0)).max() < 60
