"""Kinds of motion: labels as the sources write them, each in the group a person would choose."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import pytest

from scenectl.data.kinds import REST, kind

CLIPS = Path(__file__).parents[4] / "shared/data/motions/clips.jsonl"


def test_copies_do_not_count_as_recordings_of_their_kind() -> None:
    """Reaches made of walks are many, and had drowned the few that were recorded."""
    assert kind("cmu", "walk, reach") == "reach while walking" != kind("hdm05", "depositFloorR")


@pytest.mark.parametrize(
    ("source", "label", "wanted"),
    [
        ("bandai", "walk-turn-left", "bandai: walk-turn-left"),
        ("bandai", "walk, duck", "duck"),
        ("snu", "walk_normal_stright", "walk"),
        ("snu", "walk_normal_right_45", "turn"),
        ("cmu", "walk, veer left", "turn"),
        ("cmu", "soccer - kick ball", "ball"),
        ("cmu", "balance on one leg, outstretched arms", "gesture"),
        ("cmu", "jump kick", "fight"),
        ("cmu", "run/jog, sudden stop", "run"),
        ("hdm05", "depositFloorR", "reach"),
        ("hdm05", "squat1Reps", "squat"),
        ("mesh2motion", "Sitting_Idle_Loop", "sit and kneel"),
        ("cmu", "unheard of", REST),
    ],
)
def test_labels_find_their_group(source: str, label: str, wanted: str) -> None:
    assert kind(source, label) == wanted


@pytest.mark.skipif(not CLIPS.is_file(), reason="../shared with the motion collection is absent")
def test_every_clip_of_the_collection_has_a_kind() -> None:
    rows = [json.loads(line) for line in CLIPS.read_text().splitlines()]
    tests = Counter(kind(r["source"], r["label"].split(" | ")[0]) for r in rows if r["split"] == "test")
    assert REST not in tests
    assert sum(count >= 5 for name, count in tests.items() if not name.startswith("bandai")) >= 8
