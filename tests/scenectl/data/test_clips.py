"""Clips as features: what is drawn, how often, and the same again."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from scenectl.data.augment import Augmentation
from scenectl.data.clips import ClipSet, Told, beginnings, census, overlapping, prepare
from scenectl.data.features import GROUPS, features_to_joints
from scenes.errors import UserError
from tests.scenectl.training.folder import walks

PLAIN = Augmentation.none()


def numbered(lengths: list[int], groups: list[str]) -> ClipSet:
    """Clips whose rows say which clip and which row they are."""
    starts = torch.tensor([0, *torch.tensor(lengths).cumsum(0).tolist()])
    rows = torch.zeros(sum(lengths), 263)
    for i, length in enumerate(lengths):
        rows[starts[i] : starts[i + 1], 0] = i
        rows[starts[i] : starts[i + 1], 1] = torch.arange(length)
    n = len(lengths)
    ids = [str(i) for i in range(n)]
    return ClipSet(
        rows,
        starts,
        [[Told(0, length, ["a"])] for length in lengths],
        groups,
        ["cmu"] * n,
        ids,
        ["free"] * n,
        [True] * n,
    )


def seeded(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def test_windows_are_whole_pieces_of_clips_that_are_long_enough() -> None:
    data = numbered([10, 30, 12, 11], list("abcd"))
    rows, clips, _ = data.draw(12, 500, seeded(0))
    assert rows.shape == (500, 12, 263) and set(clips.tolist()) == {1, 2}
    assert (rows[..., 0] == clips[:, None]).all()
    assert (rows[..., 1].diff(dim=1) == 1).all()
    starts = rows[clips == 1][:, 0, 1]
    assert set(starts.int().tolist()) == set(range(19))  # all offsets, first and last included


def test_draws_depend_on_the_generator_alone() -> None:
    data = numbered([40, 50], ["a", "b"])
    torch.manual_seed(1)
    first = data.draw(8, 20, seeded(4))
    torch.manual_seed(2)
    again, other = data.draw(8, 20, seeded(4)), data.draw(8, 20, seeded(5))
    assert torch.equal(first[0], again[0]) and torch.equal(first[1], again[1])
    assert not torch.equal(first[0], other[0])


def test_windows_on_a_device_are_cut_there() -> None:
    data = numbered([40, 50], ["a", "b"])
    there = data.on(torch.device("meta"))
    rows, clips, _ = there.draw(8, 20, seeded(4))
    assert rows.device.type == "meta" and rows.shape == (20, 8, 263)
    assert torch.equal(clips, data.draw(8, 20, seeded(4))[1])  # the same clips as on the CPU


def test_windows_are_as_short_as_clips() -> None:
    generator = torch.Generator().manual_seed(0)
    clips = numbered([41, 36, 20, 300], ["sit down", "sit down", "wave", "walk"])
    drawn = [clips.draw_length(36, 196, 4, generator) for _ in range(2000)]
    assert set(drawn) == set(range(36, 200, 4))
    short = clips._weights(36)[:2].sum() / clips._weights(36).sum()  # 36 or 40 frames, or 36; the third clip never
    expected = float(short) + (1 - float(short)) * 0.5 * 2 / 41
    assert abs(sum(frames <= 40 for frames in drawn) / len(drawn) - expected) < 0.04
    whole = (1 - float(short)) * (0.5 + 0.5 / 41)  # half of the windows are as long as clips or networks allow
    assert abs(drawn.count(196) / len(drawn) - whole) < 0.04
    with pytest.raises(UserError, match="no clip of the training data has 304 frames"):
        clips.draw_length(304, 400, 4, generator)


def test_a_group_is_drawn_by_the_square_root_of_its_size() -> None:
    data = numbered([40] * 20, ["big"] * 16 + ["small"] * 4)
    _, clips, _ = data.draw(20, 6000, seeded(0))
    share = float((clips < 16).float().mean())
    assert share == pytest.approx(4 / (4 + 2), abs=0.03)  # sqrt(16) : sqrt(4)
    within = torch.bincount(clips, minlength=20)[:16].float()
    assert within.min() > 0.7 * within.mean()


def test_one_long_clip_does_not_outweigh_many_short_ones() -> None:
    data = numbered([5000, *[60] * 20], ["a"] * 21)
    _, clips, _ = data.draw(40, 4000, seeded(0))
    assert float((clips == 0).float().mean()) < 0.2


def test_windows_longer_than_all_clips_are_refused() -> None:
    with pytest.raises(UserError, match="31 frames"):
        numbered([30, 20], ["a", "b"]).draw(31, 4, seeded(0))


def test_statistics_are_means_and_grouped_deviations() -> None:
    data = numbered([30, 40], ["a", "b"])
    data.features.copy_(torch.randn(70, 263) * torch.rand(263) + torch.randn(263))
    data.features[:, GROUPS[-1]] = 1.0  # feet that never leave the floor
    mean, std = data.statistics()
    torch.testing.assert_close(mean, data.features.sum(0) / 70)
    own = (data.features - mean).square().sum(0).div(69).sqrt()
    for group in GROUPS[:-1]:
        torch.testing.assert_close(std[group], own[group].mean().expand(std[group].shape))
    assert torch.isfinite((data.features - mean) / std).all()


def test_a_folder_becomes_windows(tmp_path: Path) -> None:
    data = prepare(walks(tmp_path / "data"), ["train"], PLAIN, tmp_path / "cache", 0)
    assert data.lengths.tolist() == [49 + 6 * i for i in range(5)]
    assert data.groups == ["walk", "bandai: walk-turn-left", "walk", "bandai: walk", "walk"]
    assert census(data, data.sources) == {"cmu": 49 + 61 + 73, "bandai": 55 + 67}
    assert data.hours == data.recorded_hours == pytest.approx(sum(data.lengths.tolist()) / 72000)
    joints = features_to_joints(data.features[: data.starts[1]])
    assert float(joints[-1, 0, 2]) == pytest.approx(48 / 20 * 0.9, abs=0.02)


def test_terms_follow_the_strictest_clip_and_name_every_source(tmp_path: Path) -> None:
    folder = walks(tmp_path / "data")
    licence, credits = prepare(folder, ["train"], PLAIN, tmp_path / "cache", 0).terms()
    assert licence.startswith("non-commercial")
    assert len(credits) == 2 and "NSF EIA-0196217" in credits[1] and "CC BY-NC 4.0" in credits[0]
    free = prepare(folder, ["train"], PLAIN, tmp_path / "cache", 0, commercial_only=True)
    assert free.terms()[0].startswith("commercial use allowed") and set(free.sources) == {"cmu"}


def test_prepared_data_is_kept_and_made_again_when_anything_changes(tmp_path: Path) -> None:
    folder, cache = walks(tmp_path / "data"), tmp_path / "cache"
    first = prepare(folder, ["train"], PLAIN, cache, 0)
    again = prepare(folder, ["train"], PLAIN, cache, 0)
    assert torch.equal(first.features, again.features) and first.ids == again.ids
    assert len(list(cache.iterdir())) == 1
    more = prepare(folder, ["train"], Augmentation.none(mirror=True, bend=1), cache, 0)
    assert len(more.ids) > len(first.ids) and {i for i in more.ids if i.endswith("~m")}
    assert more.recorded_hours == pytest.approx(first.hours) and more.hours > 1.9 * first.hours
    prepare(folder, ["test"], None, cache, 0)
    prepare(folder, ["train"], PLAIN, cache, 1)
    assert len(list(cache.iterdir())) == 4


def test_an_empty_split_and_damaged_preparations_are_answered(tmp_path: Path) -> None:
    folder, cache = walks(tmp_path / "data"), tmp_path / "cache"
    with pytest.raises(UserError, match="split val"):
        prepare(folder, ["val"], None, cache, 0)
    prepare(folder, ["train"], PLAIN, cache, 0)
    (path,) = cache.iterdir()
    whole = path.read_bytes()
    for content in (whole[:-100], b"", b"noise" * 30):
        path.write_bytes(content)
        with pytest.raises(UserError, match="delete it and run again") as error:
            prepare(folder, ["train"], PLAIN, cache, 0)
        assert "\n" not in str(error.value)


def test_windows_of_any_length_hold_as_many_frames(tmp_path: Path) -> None:
    data = numbered([40, 50], ["a", "b"])
    shapes = {tuple(data.draw_any((8, 16, 32), 6, seeded(seed)).shape[:2]) for seed in range(20)}
    assert shapes == {(6, 8), (3, 16), (1, 32)}
    assert torch.equal(data.draw_any((8,), 4, seeded(1)), data.draw_any((8,), 4, seeded(1)))


def test_beginnings_and_overlapping_windows_are_cut_from_whole_clips() -> None:
    data = numbered([10, 30, 12], list("abc"))
    first = beginnings(data, 12)
    assert first[:, 0, :2].tolist() == [[1.0, 0.0], [2.0, 0.0]] and (first[..., 1].diff(dim=1) == 1).all()
    assert len(beginnings(data, 10, most=2)) == 2
    assert overlapping(data, 12)[:, 0, :2].tolist() == [[1.0, 0.0], [1.0, 6.0], [1.0, 12.0], [1.0, 18.0], [2.0, 0.0]]
    for cut in (beginnings, overlapping):
        with pytest.raises(UserError, match="500 frames"):
            cut(data, 500)


@pytest.mark.parametrize(
    ("key", "value"), [("licence", "CC BY-NC 9.0"), ("commercial_ok", False), ("captions", [{"text": "a person hops"}])]
)
def test_an_edited_table_of_clips_is_read_again(key: str, value: object, tmp_path: Path) -> None:
    folder, cache = walks(tmp_path / "data"), tmp_path / "cache"
    before = prepare(folder, ["train"], None, cache, 0)
    table = folder / "clips.jsonl"
    rows = [json.loads(line) for line in table.read_text().splitlines()]
    times = table.stat()
    table.write_text("\n".join(json.dumps({**row, key: value}) for row in rows))
    os.utime(table, ns=(times.st_atime_ns, times.st_mtime_ns))  # as copies that keep times have them
    after = prepare(folder, ["train"], None, cache, 0)
    found = {"licence": after.licences, "commercial_ok": after.commercial, "captions": after.captions}[key]
    wanted = ["a person hops"] if key == "captions" else value
    assert found == [wanted] * len(before.ids)


def test_trainings_at_once_share_one_cache(tmp_path: Path) -> None:
    folder, cache = walks(tmp_path / "data"), tmp_path / "cache"
    code = (
        "import sys; from pathlib import Path; from scenectl.data.clips import prepare; "
        "print(len(prepare(Path(sys.argv[1]), ['train'], None, Path(sys.argv[2]), 0).ids))"
    )
    call, pipe = [sys.executable, "-c", code, str(folder), str(cache)], subprocess.PIPE
    children = [subprocess.Popen(call, stdout=pipe, text=True) for _ in range(3)]
    said = [child.communicate()[0] for child in children]
    assert [child.returncode for child in children] == [0, 0, 0] and len(set(said)) == 1
    assert len(list(cache.iterdir())) == 1
