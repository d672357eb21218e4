"""A HumanML3D folder: its clips, parts, and mirrored copies, and one sentence for what is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from scenectl.data.features import features_to_joints
from scenectl.data.humanml3d import HumanML3D, read_captions
from scenes.errors import UserError


def rows(frames: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, 0.01, (frames, 263)).astype(np.float32)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two motions with mirrored copies, one of them with a caption of a part, and listed ids without files."""
    (tmp_path / "new_joint_vecs").mkdir()
    (tmp_path / "texts").mkdir()
    whole = "a person walks.#a/DET person/NOUN walk/VERB#0.0#0.0\n"
    part = "he turns left.#he/PRON turn/VERB left/ADV#1.0#3.5\nhe spins.#he/PRON spin/VERB#1.0#3.5\n"
    for seed, (name, frames, text) in enumerate(
        [
            ("000001", 120, whole + "someone strolls#someone/PRON stroll/VERB#nan#nan\n" + part),
            ("M000001", 120, whole),
            ("000002", 30, whole),
            ("000003", 260, whole),
        ]
    ):
        np.save(tmp_path / "new_joint_vecs" / f"{name}.npy", rows(frames, seed))
        (tmp_path / "texts" / f"{name}.txt").write_text(text)
    (tmp_path / "train.txt").write_text("000001\nM000001\n000002\n000099\n000003\n")
    (tmp_path / "test.txt").write_text("000098\n")
    return tmp_path


def test_clips_parts_and_mirrored_copies(folder: Path) -> None:
    data = HumanML3D(folder)
    clips = list(data.clips("train"))
    assert [clip.id for clip in clips] == ["000001", "000001@1-3.5", "M000001"]
    assert [clip.mirrored for clip in clips] == [False, False, True]
    assert [caption.text for caption in clips[0].captions] == ["a person walks.", "someone strolls"]
    assert [caption.text for caption in clips[1].captions] == ["he turns left.", "he spins."]
    assert clips[1].captions[0].tokens == ("he/PRON", "turn/VERB", "left/ADV")
    # the part is cut out of the clip at 20 frames a second
    assert torch.equal(clips[1].features, clips[0].features[20:70])
    assert clips[0].features.dtype == torch.float32 and clips[0].captions[0].whole and not clips[1].captions[0].whole


def test_lengths_mirrored_and_missing(folder: Path) -> None:
    data = HumanML3D(folder)
    assert [clip.id for clip in data.clips("train", mirrored=False)] == ["000001", "000001@1-3.5"]
    every = [clip.id for clip in data.clips("train", min_frames=1, max_frames=1000)]
    assert every == ["000001", "000001@1-3.5", "M000001", "000002", "000003"]
    assert [clip.id for clip in data.clips("train", min_frames=51)] == ["000001", "M000001"]


def test_published_files_are_read(shared: Path, tmp_path: Path) -> None:
    published = shared / "data" / "humanml3d"
    for part in ("new_joint_vecs", "texts"):
        (tmp_path / part).mkdir()
    for name in ("train.txt", "val.txt", "test.txt"):
        (tmp_path / name).write_bytes((published / name).read_bytes())
    (tmp_path / "new_joint_vecs" / "012314.npy").write_bytes((published / "012314_new_joint_vecs.npy").read_bytes())
    (tmp_path / "texts" / "012314.txt").write_text("a person moves#a/DET person/NOUN move/VERB#0.0#0.0\n")
    data = HumanML3D(tmp_path)
    counts = [len(data.ids(split)) for split in ("train", "val", "test")]
    assert counts == [23384, 1460, 4384]
    split = next(split for split in ("train", "val", "test") if "012314" in data.ids(split))
    (clip,) = data.clips(split)
    joints = np.load(published / "012314_new_joints.npy")
    assert np.abs(features_to_joints(clip.features).numpy() - joints).max() < 1e-5
    with pytest.raises(UserError, match="for any of the ids"):
        list(data.clips("val" if split != "val" else "test"))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("no fields at all\n", r"line 1: expected 'caption#tokens#start#end'"),
        ("ok#ok/X#0#0\n\nbad#x/Y#0.0\n", "line 3: expected"),
        ("#x/Y#0.0#0.0\n", "line 1: expected"),
        ("a#x/Y#soon#0.0\n", "found 'soon' and '0.0'"),
        ("a#x/Y#-1#2\n", "seconds from 0"),
        ("a#x/Y#0#inf\n", "seconds from 0"),
        ("\n", "holds no caption"),
    ],
)
def test_bad_captions_are_named(text: str, reason: str, tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(text)
    with pytest.raises(UserError, match=reason) as caught:
        read_captions(tmp_path / "a.txt")
    assert "a.txt" in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("array", "reason"),
    [
        (np.zeros((50, 251), np.float32), "251 features a frame instead of 263; these look like KIT's"),
        (np.zeros((50, 260), np.float32), "260 features"),
        (np.zeros((50, 22, 3), np.float32), r"not an array of \[T, 263\] floats"),
        (np.full((50, 263), np.nan, np.float32), "not finite"),
        (np.array([{}], dtype=object), "not a NumPy array"),
        (None, "not a NumPy array"),
    ],
)
def test_bad_motions_are_named(array: np.ndarray | None, reason: str, folder: Path) -> None:
    path = folder / "new_joint_vecs" / "000001.npy"
    if array is None:
        path.write_bytes(b"junk")
    else:
        np.save(path, array, allow_pickle=True)
    with pytest.raises(UserError, match=reason) as caught:
        list(HumanML3D(folder).clips("train"))
    assert "000001.npy" in str(caught.value)


def test_bad_folders_are_named(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="does not exist"):
        HumanML3D(tmp_path / "absent")
    with pytest.raises(UserError, match="no folder 'new_joint_vecs'"):
        HumanML3D(folder / "texts")
    data = HumanML3D(folder)
    with pytest.raises(UserError, match="did you mean 'train'"):
        data.ids("trian")
    with pytest.raises(UserError, match=r"no val\.txt"):
        list(data.clips("val"))
    with pytest.raises(UserError, match="for any of the ids"):
        list(data.clips("test"))


def test_files_that_are_no_text_are_named(folder: Path) -> None:
    (folder / "train.txt").write_bytes(b"000001\n\xff\xfe\n")
    with pytest.raises(UserError, match=r"list of ids '.*train.txt' cannot be read"):
        HumanML3D(folder).ids("train")
    (folder / "texts" / "000001.txt").write_bytes(b"\xff\xfe")
    with pytest.raises(UserError, match=r"caption file '.*000001.txt' cannot be read"):
        read_captions(folder / "texts" / "000001.txt")
    (folder / "texts" / "000001.txt").unlink()
    (folder / "texts" / "000001.txt").mkdir()
    with pytest.raises(UserError, match="cannot be read"):
        read_captions(folder / "texts" / "000001.txt")


@pytest.mark.parametrize(("start", "end"), [("1e308", "0.0"), ("0.0", "inf"), ("1e308", "1e308"), ("-inf", "3")])
def test_times_beyond_reason_are_named(start: str, end: str, tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(f"a person walks.#a/DET#{start}#{end}\n")
    with pytest.raises(UserError, match="must be seconds"):
        read_captions(tmp_path / "a.txt")


def test_numbers_too_large_for_features_are_named(folder: Path) -> None:
    np.save(folder / "new_joint_vecs" / "000001.npy", np.full((120, 263), 1e300))
    with pytest.raises(UserError, match="not finite"):
        list(HumanML3D(folder).clips("train"))
