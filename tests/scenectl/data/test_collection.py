"""A collection made of anybody's motions is read as they are."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from scenectl.data.collection import write_collection
from scenectl.data.corpus import load_motions
from scenectl.data.features import canonicalise, to_uniform_skeleton
from scenes.errors import UserError
from scenes.motion.motion import Motion
from tests.scenectl.small import walk


def test_what_is_written_is_read(tmp_path: Path) -> None:
    joints, fast = walk(60), Motion(walk(60)).resampled(60.0)
    clips = {
        "a": (Motion(joints), {"captions": "A person walks."}),
        "b": (fast, {"captions": ["one", "two"], "label": "walk", "licence": "CC0", "commercial_ok": True}),
    }
    first, second = load_motions(write_collection(tmp_path / "new", clips))
    assert (first.id, first.captions, first.split, first.commercial_ok) == ("a", ("a person walks.",), "train", False)
    assert (second.captions, second.licence, second.commercial_ok) == (("one", "two"), "CC0", True)
    wanted = canonicalise(to_uniform_skeleton(joints))
    for clip in (first, second):
        torch.testing.assert_close(clip.joints, wanted, atol=5e-3, rtol=0)


def test_what_cannot_be_written_is_a_sentence(tmp_path: Path) -> None:
    told = {"captions": "x"}
    for clips, words in (
        ({}, "no clip"),
        ({"a": (Motion(walk(60)), {})}, "'a' has no caption"),
        ({"a": (Motion(walk(60)[None]), told)}, "no single motion"),
        ({"a": (Motion(walk(60) * 1000), told)}, "is it in metres"),
    ):
        with pytest.raises(UserError, match=words):
            write_collection(tmp_path, clips)
