"""The second classifier: single acts out of clips of several, pieces to test it on, windows, weights that ship."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
import torch

from scenectl.data.clips import ClipSet, Told
from scenectl.data.features import joints_to_features
from scenectl.evaluation import SHIPPED
from scenectl.evaluation.acts import held_out_pieces, is_edit, single_acts
from scenectl.evaluation.kinds import ACTS, WINDOWS, Confusion, load_classifier
from scenectl.evaluation.training import EvaluatorTraining, _Whole, train_acts
from scenectl.training.loop import LoopSettings
from scenes.errors import UserError
from tests.scenectl.small import walk
from tests.scenectl.training.folder import walks, write_folder

FROZEN = {
    "kinds.safetensors": "d5fcfb28faafbd477b05da01131042b81997d8fb1b409388091aa9b90f324ef2",
    "contrastive.safetensors": "85e74ba22ef779c072f1829b65971bf4639fd4f3c778fc4c003b38cfe231fd05",
}


def told(*clips: tuple[str, str, list[Told]]) -> ClipSet:
    """Clips by id, kind and stretches, as long as the first stretch."""
    rows = [joints_to_features(walk(stretches[0].end + 1)) for _, _, stretches in clips]
    names, kinds, stretches = zip(*clips, strict=True)
    many = {"sources": ["cmu"] * len(clips), "licences": ["free"] * len(clips), "commercial": [True] * len(clips)}
    return ClipSet.of(rows, told=list(stretches), groups=list(kinds), ids=list(names), **many)


def test_what_judged_before_stays_as_it_is() -> None:
    for name, digest in FROZEN.items():
        assert hashlib.sha256((SHIPPED / name).read_bytes()).hexdigest() == digest, f"{name} is frozen"


def test_acts_of_composed_clips_get_the_kind_that_their_sentences_are_said_of() -> None:
    clips = told(
        ("a", "walk", [Told(0, 60, ["a person walks.", "someone moves."])]),
        ("b", "sit down", [Told(0, 50, ["a person sits down.", "someone moves."])]),
        (
            "a~c1",
            "composed",
            [
                Told(0, 90, ["a person walks, then sits down."], 3),
                Told(0, 40, ["a person walks."]),
                Told(40, 70, ["a person sits down."]),
                Told(70, 90, ["someone moves."]),  # said of both kinds
                Told(0, 70, ["a person walks and sits down."], 2),
            ],
        ),
    )
    cut = single_acts(clips)
    assert cut.groups == ["walk", "sit down", "walk", "sit down"] and cut.lengths.tolist() == [60, 50, 40, 30]
    torch.testing.assert_close(cut.features[110:150], clips.features[110:150])
    assert all(len(stretches) == 1 and stretches[0].acts == 1 for stretches in cut.told)


def held_out_pieces_come_from_held_out_takes_alone(tmp_path: Path) -> None:
    takes = {"train": walk(130), "test": walk(130, speed=1.0)}
    folder = write_folder(tmp_path / "d", {name: (joints, {"split": name}) for name, joints in takes.items()})
    pieces = held_out_pieces(folder, tmp_path / "c")
    assert pieces.ids and all(name.startswith("test~") for name in pieces.ids)
    assert all(is_edit(name) for name in pieces.ids) and len(set(pieces.groups)) > 1
    assert not is_edit("13_01") and not is_edit("13_01~sit-down42")
    assert is_edit("13_01~pick-up") and is_edit("13_01~idle42~pick-up")
    assert is_edit("composed1~13_01+13_02~idle42")


def test_samples_are_windows_as_often_as_settings_say(tmp_path: Path) -> None:
    clips = told(*((f"c{i}", "walk", [Told(0, 120, ["a person walks."])]) for i in range(3)))
    whole = _Whole(clips, EvaluatorTraining(), 32, windows=0.5)
    lengths = whole.draw(400, torch.Generator().manual_seed(0))[0].lengths
    short = lengths <= 20 * WINDOWS[-1]
    assert 0.4 < float(short.float().mean()) < 0.6
    assert int(lengths[short].min()) >= 32 - 3 and int(lengths[~short].min()) >= 0.7 * 120 - 3


def test_it_is_trained_by_a_command_of_its_own(tmp_path: Path) -> None:
    settings = EvaluatorTraining(acts=LoopSettings(iterations=2, batch=4))
    folder = train_acts(walks(tmp_path / "data"), tmp_path / "run", settings=settings)
    assert [path.name for path in folder.iterdir()] == [ACTS]
    kinds = load_classifier(folder, ACTS).kinds
    assert {"walk", "crouch"} <= set(kinds)
    with pytest.raises(UserError, match="do not exist"):
        load_classifier(tmp_path, ACTS)


def test_rare_kinds_are_pooled() -> None:
    found = Confusion.of(["a"] * 4 + ["b"] * 2 + ["c"] * 2, ["a"] * 3 + ["b"] * 2 + ["a"] + ["c", "d"])
    assert found.clips == {"a": 4, "b": 2, "c": 2}
    assert found.recall_of(["a"]) == 0.75 and found.recall_of(["b", "c"]) == 0.5 and found.recall_of(["d"]) is None
    assert found.recall_of(kind for kind in ("b", "c")) == 0.5
