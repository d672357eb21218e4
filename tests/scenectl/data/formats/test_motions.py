"""Motions that others wrote: what is the same is read the same, and what cannot be right is a sentence."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st

from scenectl.data.features import joints_to_features
from scenectl.data.formats.motions import load_motion, one_of, read_motion
from scenectl.data.formats.people import UNITS
from scenectl.export.export import export
from scenes.errors import UserError
from scenes.mesh.scale import TO_Y_UP
from scenes.motion.kinematics import forward
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.rigid import rigid
from scenes.motion.skeleton import HUMANML3D, with_lengths
from tests.scenectl.small import walk
from tests.scenes.test_archive import claiming, zipped

WALK = walk(60).numpy()
NAMES = np.array(HUMANML3D.names)


def npz(path: Path, **arrays: Any) -> Path:
    np.savez(path / "x.npz", **{"joints": WALK, "fps": 20.0, **arrays})
    return path / "x.npz"


def npy(path: Path, array: np.ndarray) -> Path:
    np.save(path / "x.npy", array)
    return path / "x.npy"


LAYOUTS = {
    "joints": WALK,
    "samples": np.stack([WALK, WALK]),
    "flat": WALK.reshape(60, 66),
    "flat samples": np.stack([WALK, WALK]).reshape(2, 60, 66),
    "doubles": WALK.astype(np.float64),
    "halves": WALK.astype(np.float16),
    "the other order in memory": np.asfortranarray(WALK),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts_of_joints(layout: str, tmp_path: Path) -> None:
    reading = read_motion(npy(tmp_path, LAYOUTS[layout]), fps=30)
    assert reading.motion.fps == 30 and not reading.doubts and reading.motion.joints.dtype == torch.float32
    wanted = torch.from_numpy(WALK).expand(reading.motion.joints.shape)
    torch.testing.assert_close(reading.motion.joints, wanted, atol=2e-3 if layout == "halves" else 0, rtol=0)
    assert reading.motion.joints.ndim == (4 if "samples" in layout else 3)


@pytest.mark.parametrize("suffix", ["npy", "npz"])
def test_features_are_told_by_their_number(suffix: str, tmp_path: Path) -> None:
    placed = Motion(torch.from_numpy(WALK)).placed(Pose2D((1.0, 0.3, 2.0), 0.7)).joints
    features = joints_to_features(placed).numpy()
    path = tmp_path / f"x.{suffix}"
    np.save(path, features) if suffix == "npy" else np.savez(path, features=features, fps=20)
    one = load_motion(path, fps=20)
    assert one.frames == 59 and float(one.joints[..., 1].min()) == pytest.approx(0.0, abs=1e-3)
    own, theirs = (torch.cdist(j.flatten(0, 1), j.flatten(0, 1)) for j in (one.joints[::20], placed[:59][::20]))
    torch.testing.assert_close(own, theirs, atol=5e-3, rtol=0)
    normalised = (features - features.mean(0)) / (features.std(0) + 1e-3)
    np.save(tmp_path / "n.npy", normalised)
    try:
        assert "times the data set's Std.npy" in read_motion(tmp_path / "n.npy", fps=20).doubts[0]
    except UserError as error:
        assert "legs would be" in str(error)


def test_what_is_saved_is_read(tmp_path: Path) -> None:
    made = Motion(torch.from_numpy(WALK)[None], torch.arange(60)[None] < 50, 30.0, 2.0)
    made.save(tmp_path / "motion.npz", seed=3)
    for path in (tmp_path, tmp_path / "motion.npz"):
        reading = read_motion(path)
        assert not reading.doubts and not reading.notes
        back = reading.motion
        assert torch.equal(back.joints, made.joints) and torch.equal(back.valid, made.valid)
        assert (back.fps, back.t0, back.skeleton) == (30.0, 2.0, HUMANML3D)


def test_other_people_keep_their_proportions(tmp_path: Path) -> None:
    taller = rigid(Motion(torch.from_numpy(WALK)), with_lengths(HUMANML3D, 1.1 * HUMANML3D.bone_lengths))
    back = load_motion(npz(tmp_path, joints=taller.joints.numpy()))
    np.testing.assert_allclose(back.skeleton.bone_lengths, 1.1 * HUMANML3D.bone_lengths, atol=1e-5)
    assert (forward(back.rotations, back.joints[:, 0], back.skeleton) - taller.joints).abs().max() < 1e-4
    own = with_lengths(HUMANML3D, np.linspace(0.9, 1.1, 22) * HUMANML3D.bone_lengths)
    rigid(taller, own).save(tmp_path / "own.npz")
    assert load_motion(tmp_path / "own.npz").skeleton == own
    export(rigid(taller, own), tmp_path / "own.bvh")
    np.testing.assert_allclose(load_motion(tmp_path / "own.bvh").skeleton.bone_lengths, own.bone_lengths, atol=1e-5)


@pytest.mark.parametrize("offsets", [HUMANML3D.offsets, 1.3 * np.array(HUMANML3D.offsets)])
def test_joints_count_more_than_what_else_a_file_says(offsets: Any, tmp_path: Path) -> None:
    walk = rigid(Motion(torch.from_numpy(WALK)))
    walk.save(tmp_path / "x.npz", offsets=np.array(offsets), rotations=np.full((60, 22, 4), 0.5))
    back = load_motion(tmp_path / "x.npz")
    np.testing.assert_allclose(back.skeleton.bone_lengths, HUMANML3D.bone_lengths, atol=1e-5)
    torch.testing.assert_close(back.rotations, walk.rotations, atol=1e-4, rtol=0)
    walk.save(tmp_path / "x.npz", rotations=np.zeros((60, 22, 4)))
    with pytest.raises(UserError, match="'rotations' are off unit length by 1"):
        load_motion(tmp_path / "x.npz")


def test_names_decide_which_joint_is_which(tmp_path: Path) -> None:
    order = np.random.default_rng(0).permutation(22)
    for names in (NAMES, np.array([f"mixamorig:{name}" for name in NAMES]), NAMES.astype(np.bytes_)):
        back = load_motion(npz(tmp_path, joints=WALK[:, order], joint_names=names[order]))
        assert np.array_equal(back.joints.numpy(), WALK)
    more = np.concatenate([WALK, WALK[:, :2]], axis=1)
    back = load_motion(npz(tmp_path, joints=more, joint_names=[*NAMES, "left_hand", "right_hand"]))
    assert np.array_equal(back.joints.numpy(), WALK)


def test_a_bvh_file_is_read_at_its_own_rate(tmp_path: Path) -> None:
    export(Motion(torch.from_numpy(WALK), fps=30.0), tmp_path / "x.bvh")
    reading = read_motion(tmp_path / "x.bvh")
    assert reading.motion.fps == 30.0 and "unit cm (guessed" in reading.notes[0] and not reading.doubts
    assert (reading.motion.joints - torch.from_numpy(WALK)).abs().max() < 0.02
    assert load_motion(tmp_path / "x.bvh", fps=60).fps == 60.0
    assert "30 frames a second, and 60 were stated" in read_motion(tmp_path / "x.bvh", fps=60).doubts[0]


def test_frames_a_second_are_stated_in_the_file_or_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"x\.npy.*state them, such as --fps 30"):
        load_motion(npy(tmp_path, WALK))
    assert load_motion(npz(tmp_path)).fps == 20.0
    assert load_motion(npz(tmp_path, fps=np.array([50]))).fps == 50.0
    reading = read_motion(npz(tmp_path), fps=25)
    assert reading.motion.fps == 25 and "says 20 frames a second, and 25 were stated" in reading.doubts[0]
    for fps in (0, -1, 1e-300, 1e300, float("nan"), float("inf")):
        with pytest.raises(UserError, match="frames a second"):
            load_motion(npz(tmp_path), fps=fps)


@pytest.mark.parametrize("unit", [unit for unit in UNITS if unit not in ("m", "cmu")])
def test_units_are_stated_or_told(unit: str, tmp_path: Path) -> None:
    theirs = WALK / UNITS[unit]
    for path, words in ((npy(tmp_path, theirs), {"unit": unit}), (npz(tmp_path, joints=theirs, unit=unit), {})):
        reading = read_motion(path, fps=20, **words)
        torch.testing.assert_close(reading.motion.joints, torch.from_numpy(WALK), atol=1e-4, rtol=0)
        assert not reading.doubts
    try:
        said = read_motion(npy(tmp_path, theirs), fps=20).doubts[0]
    except UserError as error:
        said = str(error)
    assert f"state --unit {unit}" in said


@pytest.mark.parametrize("up", ["x", "z"])
def test_axes_are_stated_or_doubted(up: str, tmp_path: Path) -> None:
    path = npy(tmp_path, WALK @ TO_Y_UP[up])
    reading = read_motion(path, fps=20, up=up)
    assert not reading.doubts
    torch.testing.assert_close(reading.motion.joints, torch.from_numpy(WALK), atol=1e-5, rtol=0)
    assert f"along {up}; state --up {up}, or --up y" in read_motion(path, fps=20).doubts[0]
    assert not read_motion(path, fps=20, up="y").doubts


def changed(at: tuple[int, ...], value: float) -> np.ndarray:
    joints = WALK.astype(np.float64)
    joints[at] = value
    return joints


OURS: dict[str, Any] = {
    "joint_names": NAMES, "parents": np.array(HUMANML3D.parents), "offsets": np.array(HUMANML3D.offsets)
}  # fmt: skip
UNSOUND: dict[str, tuple[dict[str, Any], str]] = {
    "one frame": ({"joints": WALK[:1]}, "1 frame; a motion has 2"),
    "no frame": ({"joints": WALK[:0]}, "no frames"),
    "no sample": ({"joints": np.zeros((0, 60, 22, 3))}, "no motion"),
    "five axes": ({"joints": WALK[None, None]}, "shape"),
    "one axis": ({"joints": WALK.ravel()}, "shape"),
    "features of KIT": ({"joints": np.zeros((60, 251))}, "shape"),
    "text": ({"joints": np.full((60, 22, 3), "x")}, "not numbers"),
    "complex": ({"joints": WALK.astype(complex)}, "not numbers"),
    "a joint far away": ({"joints": changed((3, 20, 0), 1e20)}, "left_wrist is 1e.20 m|from the origin"),
    "a joint away": ({"joints": changed((3, 20, 0), 1e4)}, "left_wrist is 1e.04 m from its pelvis at frame 3"),
    "somewhere else": ({"joints": WALK + 1e12}, "from the origin|legs"),
    "nan": ({"joints": changed((3, 20, 0), np.nan)}, "not finite"),
    "inf": ({"joints": changed((3, 20, 0), np.inf)}, "not finite"),
    "all in one place": ({"joints": WALK * 0}, "legs would be 0 m long.*no unit"),
    "valid all false": ({"valid": np.zeros(60, bool)}, "0 real frames"),
    "valid without axes": ({"valid": np.array(True)}, "'valid' have shape"),
    "valid of text": ({"valid": np.full(60, "yes")}, "'valid' are of type"),
    "valid with a hole": ({"valid": np.arange(60) != 30}, "after padding"),
    "fps 1e-300": ({"fps": 1e-300}, "frames a second"),
    "fps nan": ({"fps": np.nan}, "frames a second"),
    "fps of text": ({"fps": "20"}, "'fps' are of type"),
    "fps of several": ({"fps": np.array([20, 30])}, "'fps' has shape"),
    "hours": ({"joints": np.repeat(WALK, 100, axis=0), "fps": 1}, "lasts 6000 s"),
    "t0 1e30": ({"t0": 1e30}, "begins at 1e.30"),
    "t0 nan": ({"t0": np.nan}, "begins at nan"),
    "names of another number": ({"joint_names": NAMES[:5]}, "'joint_names' have shape"),
    "names that are none": ({"joint_names": np.arange(22)}, "22 names"),
    "strange names": ({"joint_names": np.array([f"j{k}" for k in range(22)])}, "no joint found"),
    "no spine": ({"joints": WALK[:, NAMES != "spine2"], "joint_names": NAMES[NAMES != "spine2"]}, "no joint found"),
    "other joints": ({"joints": np.zeros((60, 24, 3))}, "24 joints without 'joint_names'"),
    "parents of 99": ({"parents": np.full(22, 99)}, "parents of joints are"),
    "parents in a ring": ({"parents": np.roll(np.arange(22), 1)}, "parents of joints are"),
    "parents of text": ({"parents": NAMES}, "'parents' are of type"),
    "offsets nan": ({"offsets": np.full((22, 3), np.nan)}, "offsets of joints are finite"),
    "offsets of another number": ({"offsets": np.zeros((3, 3))}, "'offsets' have shape"),
    "offsets of unnamed joints": ({"joints": WALK.reshape(60, 66), "offsets": np.zeros((3, 3))}, "shape"),
    "a unit of numbers": ({"unit": 3.0}, "'unit' is no word"),
    "an unknown unit": ({"unit": "miles"}, "unknown unit 'miles'"),
    "an unknown axis": ({"up": "w"}, "unknown up axis 'w'"),
}


@pytest.mark.parametrize("case", UNSOUND)
def test_unsound_motions_get_one_sentence(case: str, tmp_path: Path) -> None:
    arrays, words = UNSOUND[case]
    with pytest.raises(UserError, match=words) as caught:
        load_motion(npz(tmp_path, **arrays))
    assert str(caught.value).startswith(f"motion file '{tmp_path / 'x.npz'}': ") and len(str(caught.value)) < 400


def test_files_of_other_kinds_get_one_sentence(tmp_path: Path) -> None:
    np.savez(tmp_path / "amass.npz", poses=WALK, trans=WALK, mocap_framerate=120)
    np.savez(tmp_path / "other.npz", foo=WALK)
    np.savez(tmp_path / "none.npz")
    np.save(tmp_path / "dict.npy", np.array({"motion": WALK}, dtype=object), allow_pickle=True)
    (tmp_path / "text.npz").write_text("hello")
    (tmp_path / "walk.fbx").write_text("hello")
    (tmp_path / "folder.npz").mkdir()
    sentences = {
        "amass.npz": "SMPL need its body model", "other.npz": "holds foo, and", "none.npz": "holds nothing",
        "dict.npy": "pickled", "text.npz": "zip", "walk.fbx": r"\.npz, \.npy, \.bvh are read",
        "gone.npy": "does not exist", "folder.npz": "motion.npz' does not exist",
    }  # fmt: skip
    for name, words in sentences.items():
        with pytest.raises(UserError, match=words):
            load_motion(tmp_path / name, fps=20)


def test_a_small_file_never_takes_much_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenes.motion.motion.MOST_BYTES", 10**7)
    np.save(tmp_path / "joints.npy", WALK)
    names = claiming((10**7,), "<U1", bytes(4 * 10**7))
    with_names = zipped(tmp_path / "names.npz", joints=(tmp_path / "joints.npy").read_bytes(), joint_names=names)
    long = zipped(tmp_path / "long.npz", joints=claiming((100_000, 22, 3), data=bytes(264 * 10**5)))
    for path, words in ((with_names, r"'joint_names' have shape \(10000000,\)"), (long, "0.0264 GB")):
        assert path.stat().st_size < 10**6
        tracemalloc.start()
        with pytest.raises(UserError, match=words):
            load_motion(path, fps=20)
        assert tracemalloc.get_traced_memory()[1] < 10**6
        tracemalloc.stop()


@settings(max_examples=150, deadline=None)
@given(at=st.integers(0, 20_000), value=st.integers(0, 255), cut=st.integers(0, 100_000), kind=st.integers(0, 2))
def test_damage_is_a_sentence(
    at: int, value: int, cut: int, kind: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("x")
    if kind == 0:
        path = npz(folder, joints=WALK[:4], **OURS)
    elif kind == 1:
        path = npy(folder, WALK[:4])
    else:
        path = folder / "x.bvh"
        export(Motion(torch.from_numpy(WALK[:4])), path)
    content = bytearray(path.read_bytes())
    content[at % len(content)] = value
    path.write_bytes(content[: len(content) - cut % len(content)] if cut % 2 == 0 else content)
    try:
        assert torch.isfinite(load_motion(path, fps=20).joints).all()
    except UserError as error:
        assert "\n" not in str(error)


def test_a_sample_is_one_of_those_there_are() -> None:
    one, two = Motion(torch.from_numpy(WALK)), Motion(torch.from_numpy(np.stack([WALK, WALK + 1])))
    assert torch.equal(one_of(one, 0, "x").joints, one.joints) and torch.equal(
        one_of(two, 1, "x").joints, one.joints + 1
    )
    with pytest.raises(UserError, match="'x' holds one motion; --sample is 0"):
        one_of(one, 3, "x")
    with pytest.raises(UserError, match="'x' holds 2 motions; --sample goes from 0 to 1"):
        one_of(two, 2, "x")
