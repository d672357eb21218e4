"""The loader against the README's own ten lines, and copies of clips that stay physical."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from scenectl.data import held_out
from scenectl.data.augment import Augmentation, augmented
from scenectl.data.corpus import CREDITS, Clip, bent, load_motions, mirrored, retimed
from scenectl.data.features import canonicalise, to_uniform_skeleton
from scenes.errors import UserError
from scenes.motion.skeleton import HUMANML3D
from tests.scenectl.small import walk
from tests.scenectl.training.folder import walks, write_folder


def readme_load(path: Path) -> dict[str, np.ndarray]:
    """The loader printed in the collection's README."""
    z = np.load(path)
    deltas = z["delta"].transpose(2, 0, 1)
    ends = np.cumsum(np.r_[0, z["length"]])
    out = {}
    for i, key in enumerate(z["ids"]):
        a = np.cumsum(deltas[ends[i] : ends[i + 1]].astype(np.int32), 0) * float(z["quant"])
        a[:, 1:] += a[:, :1]
        out[str(key)] = a.astype("float32")
    return out


def clip(joints: Tensor, **changes: object) -> Clip:
    made = Clip("a", joints, ("a person walks.",), "cmu", "train", "walk", "free", True)
    return replace(made, **changes)


def bones(joints: Tensor) -> Tensor:
    return torch.stack([(joints[:, c] - joints[:, p]).norm(dim=-1) for p, c in HUMANML3D.bones], dim=-1)


UNIFORM = torch.tensor([HUMANML3D.bone_lengths[c] for _, c in HUMANML3D.bones], dtype=torch.float32)


def slide(joints: Tensor, foot: int, still: Tensor) -> float:
    """Farthest that an ankle which ought to stand moves between two frames, metres."""
    return float(joints[:, foot].diff(dim=0).norm(dim=-1)[still].max())


def standing(joints: Tensor, foot: int) -> Tensor:
    return joints[:, foot].diff(dim=0).norm(dim=-1) < 1e-3


def test_the_test_walk_is_a_walk() -> None:
    joints = walk(80)
    torch.testing.assert_close(bones(joints), UNIFORM.expand(80, -1), atol=1e-4, rtol=0)
    for ankle in (7, 8):
        assert 0.3 < float(standing(joints, ankle).float().mean()) < 0.6
    assert float(joints[-1, 0, 2]) == pytest.approx(79 / 20 * 1.2, abs=1e-3)


def test_a_folder_is_read_back(tmp_path: Path) -> None:
    folder = walks(tmp_path)
    train = load_motions(folder)
    assert [c.id for c in train] == [f"clip{i}" for i in range(5)]
    assert [c.id for c in load_motions(folder, ["test"])] == ["clip5", "clip6"]
    assert len(load_motions(folder, ["train", "test"])) == 7
    assert train[1].label == "walk-turn-left" and not train[1].commercial_ok and train[0].commercial_ok
    assert train[2].captions == ("a person walks, take 2, left.",)
    for i, got in enumerate(train):
        wanted = canonicalise(walk(50 + 6 * i, speed=0.9 + 0.1 * i, turn=0.4 * i))
        assert got.frames == 50 + 6 * i
        torch.testing.assert_close(got.joints, wanted, atol=0.02, rtol=0)


def test_the_loader_agrees_with_the_readmes(tmp_path: Path) -> None:
    folder = walks(tmp_path)
    plain = readme_load(folder / "motions_20fps.npz")
    for got in load_motions(folder, ["train", "test"]):
        wanted = canonicalise(to_uniform_skeleton(torch.from_numpy(plain[got.id])))
        torch.testing.assert_close(got.joints, wanted, atol=1e-5, rtol=0)


def test_the_shared_collection_is_read_as_its_readme_reads_it(shared: Path) -> None:
    folder = shared / "data" / "motions"
    plain = readme_load(folder / "motions_20fps.npz")
    rows = {row["id"]: row for row in map(json.loads, (folder / "clips.jsonl").read_text().splitlines())}
    clips = load_motions(folder, ["test"])
    assert len(clips) > 100 and all(rows[c.id]["split"] == "test" for c in clips)
    assert {c.source for c in clips} <= set(CREDITS)
    for got in clips[:: len(clips) // 12]:
        row = rows[got.id]
        assert got.frames == row["n_frames"] == len(plain[got.id]) and got.licence == row["licence"]
        wanted = canonicalise(to_uniform_skeleton(torch.from_numpy(plain[got.id])))
        torch.testing.assert_close(got.joints, wanted, atol=1e-4, rtol=0)
        torch.testing.assert_close(bones(got.joints), UNIFORM.expand(got.frames, -1), atol=1e-4, rtol=0)


def test_takes_held_out_are_in_no_split_but_their_own(shared: Path) -> None:
    folder = shared / "data" / "motions"
    rows = [json.loads(line) for line in (folder / "clips.jsonl").read_text().splitlines()]
    kept = load_motions(folder, [held_out.SPLIT])
    assert {(c.source, c.id) for c in kept} == set(held_out.TAKES) and {c.split for c in kept} == {held_out.SPLIT}
    others = load_motions(folder, ["train", "val", "test"])
    assert not set(held_out.TAKES) & {(c.source, c.id) for c in others}
    # The collection's own test is what figures were measured on.
    assert not any(row["split"] == "test" for row in rows if (row["source"], row["id"]) in held_out.TAKES)


def test_takes_are_held_out_by_source_too(tmp_path: Path) -> None:
    """A user's own clip may well be called 14_28."""
    folder = write_folder(tmp_path, {"14_28": (walk(40), {"source": "own"}), "14_31": (walk(40), {"source": "cmu"})})
    assert [c.id for c in load_motions(folder)] == ["14_28"]
    assert [c.id for c in load_motions(folder, [held_out.SPLIT])] == ["14_31"]


def test_the_worst_captures_of_the_shared_collection_are_left_out(shared: Path, tmp_path: Path) -> None:
    """Above 50 m/s^2 at the pelvis; salsa_20 and salsa_24, which jump less (36 and 47), still pass."""
    plain = readme_load(shared / "data" / "motions" / "motions_20fps.npz")
    names = ("01_14", "salsa_04", "salsa_09", "01_01")
    folder = write_folder(tmp_path, {name: (torch.from_numpy(plain[name]), {}) for name in names})
    assert [c.id for c in load_motions(folder)] == ["01_01"]


def test_clips_that_jump_are_left_out(tmp_path: Path) -> None:
    jump, fine = walk(40), walk(40)
    jump[20:] += torch.tensor([0.5, 0.0, 0.0])
    folder = write_folder(tmp_path, {"jump": (jump, {}), "fine": (fine, {}), "short": (fine[:1], {})})
    assert [c.id for c in load_motions(folder)] == ["fine"]


def test_captions_of_a_part_are_left_out(tmp_path: Path) -> None:
    captions = [
        {"text": "All of it. "},
        {"text": "most of it", "start": 0.1, "end": 2.0},
        {"text": "the end", "start": 1.5, "end": 2.0},
    ]
    folder = write_folder(tmp_path, {"a": (walk(40), {"captions": captions})})
    assert load_motions(folder)[0].captions == ("all of it.", "most of it")


def test_damage_is_answered_in_a_sentence(tmp_path: Path) -> None:
    folder = walks(tmp_path)
    whole = {name: (folder / name).read_bytes() for name in ("motions_20fps.npz", "clips.jsonl")}
    npz = whole["motions_20fps.npz"]
    flipped = bytearray(npz)
    flipped[200:400] = bytes(200)
    cases = [
        ("motions_20fps.npz", npz[: len(npz) // 2]),
        ("motions_20fps.npz", b""),
        ("motions_20fps.npz", b"no archive at all"),
        ("motions_20fps.npz", bytes(flipped)),
        ("clips.jsonl", b"{"),
        ("clips.jsonl", b"\xff\xfe\x00"),
        ("clips.jsonl", b"[1, 2]\n"),
        ("clips.jsonl", whole["clips.jsonl"].replace(b'"clip0"', b'"other"')),
        ("clips.jsonl", whole["clips.jsonl"].replace(b'"captions": [', b'"captions": 3, "was": [')),
        ("clips.jsonl", whole["clips.jsonl"].replace(b'"split"', b'"part"')),
        ("clips.jsonl", b"[" * 100_000),
        ("clips.jsonl", whole["clips.jsonl"].replace(b'"commercial_ok": true', b'"commercial_ok": "false"')),
    ]
    for name, content in cases:
        for file, original in whole.items():
            (folder / file).write_bytes(original)
        (folder / name).write_bytes(content)
        with pytest.raises(UserError, match="not in the expected format") as error:
            load_motions(folder, ["train", "test"])
        assert "\n" not in str(error.value) and str(folder) in str(error.value)
    (folder / "clips.jsonl").unlink()
    with pytest.raises(UserError, match=r"has no clips\.jsonl"):
        load_motions(folder)


def test_a_mirrored_clip_swaps_sides_in_motion_words_and_label() -> None:
    words = ("he turns left, then right.", "counterclockwise", "leftover rights")
    made = clip(canonicalise(walk(40, turn=0.5)), captions=words, label="walk-turn-left")
    got = mirrored(made)
    assert got.captions == ("he turns right, then left.", "clockwise", "leftover rights")
    assert got.label == "walk-turn-right" and got.id != made.id
    torch.testing.assert_close(
        got.joints[:, 20], made.joints[:, 21] * torch.tensor([-1.0, 1.0, 1.0]), atol=1e-4, rtol=0
    )
    twice = mirrored(got)
    assert (twice.captions, twice.label) == (made.captions, made.label)
    torch.testing.assert_close(twice.joints, made.joints, atol=1e-4, rtol=0)


@pytest.mark.parametrize("curvature", [-0.4, 0.1, 0.4])
def test_a_bent_walk_turns_keeps_its_bones_and_its_planted_feet(curvature: float) -> None:
    made = clip(canonicalise(walk(60)))
    got = bent(made, curvature)
    torch.testing.assert_close(bones(got.joints), UNIFORM.expand(60, -1), atol=1e-4, rtol=0)
    for ankle in (7, 8):
        still = standing(made.joints, ankle)
        assert slide(got.joints, ankle, still) < 0.006
    travelled = 59 / 20 * 1.2
    steps = got.joints[:, 0, [0, 2]].diff(dim=0)
    heading = torch.atan2(steps[-1, 0], steps[-1, 1]) - torch.atan2(steps[0, 0], steps[0, 1])
    assert float(heading) == pytest.approx(curvature * travelled * 58 / 59, abs=0.05)
    length = float(steps.norm(dim=-1).sum())
    assert length == pytest.approx(travelled, rel=0.03)
    # Canonical again: on the floor, over the origin, facing +z.
    torch.testing.assert_close(got.joints, canonicalise(got.joints), atol=1e-5, rtol=0)


@pytest.mark.parametrize("speed", [0.87, 1.0, 1.15])
def test_a_retimed_clip_covers_the_same_path_in_another_time(speed: float) -> None:
    made = clip(canonicalise(walk(61)))
    got = retimed(made, speed)
    assert got.frames == round(60 / speed) + 1
    torch.testing.assert_close(got.joints[[0, -1]], made.joints[[0, -1]], atol=1e-5, rtol=0)
    velocity = float(got.joints[:, 0, 2].diff().mean()) * 20
    assert velocity == pytest.approx(1.2 * speed, rel=0.02)
    assert (bones(got.joints) - UNIFORM).abs().max() < 0.01
    if speed == 1.0:
        torch.testing.assert_close(got.joints, made.joints, atol=1e-5, rtol=0)


def test_the_shortest_clip_can_be_retimed() -> None:
    made = clip(walk(2))
    assert retimed(made, 5.0).frames == 2


def test_augmentation_makes_what_it_says_in_a_fixed_order() -> None:
    straight, still = clip(canonicalise(walk(60))), clip(canonicalise(walk(60, speed=0.05)), id="b")
    settings = Augmentation(composed=0.0)
    got = augmented([straight, still], settings, seed=1)
    again = augmented([straight, still], settings, seed=1)
    assert [c.id for c in got] == [c.id for c in again] and len({c.id for c in got}) == len(got)
    assert all(torch.equal(a.joints, b.joints) for a, b in zip(got, again, strict=True))
    assert [c.id for c in got[:2]] == ["a", "b"]
    assert not any(c.id.startswith("b~b") for c in got)  # who does not travel is not bent
    assert sum(c.id.endswith("~m") for c in got) == len(got) / 2
    assert any(c.id.startswith("a~b") for c in got)
    assert [c.id for c in augmented([straight], Augmentation.none(), 0)] == ["a"]
    for name in ("crouch", "duck", "sidestep", "reach"):
        only = Augmentation.none(**{name: 2})
        assert [c.id for c in augmented([straight], only, 0)] == ["a", f"a~{name}-0", f"a~{name}-1"]
    assert [c.id for c in augmented([straight], Augmentation.none(repeat=1.0), 0)] == ["a", "a~repeat"]
    running = replace(straight, label="run")
    assert len(augmented([running], Augmentation.none(crouch=1, duck=1, sidestep=1, climb=1), 0)) == 1
    turns = [
        math.copysign(1, float(c.joints[-1, 0, 0])) for c in augmented([straight], Augmentation.none(bend=12), 0)[1:13]
    ]
    assert {-1.0, 1.0} <= set(turns)
