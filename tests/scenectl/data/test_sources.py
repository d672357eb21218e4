"""Training on a HumanML3D folder: it is recognised, checked, and trained on; a wrong one is told what it lacks."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from scenectl.data.augment import Augmentation
from scenectl.data.features import joints_to_features
from scenectl.data.sources import HUMANML3D, is_humanml3d, load_clips
from scenectl.networks.checkpoint import read_about
from scenes.errors import UserError
from tests.scenectl.generators.mscot.training.test_train import TINY, train
from tests.scenectl.small import walk
from tests.scenectl.training.folder import walks


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """HumanML3D's layout with two walks to train on, one of them mirrored, and one to test on."""
    root = tmp_path / "humanml3d"
    for part in ("new_joint_vecs", "texts"):
        (root / part).mkdir(parents=True)
    for name, frames in (("000001", 80), ("M000001", 80), ("000002", 70), ("000003", 75)):
        rows = joints_to_features(walk(frames, turn=0.3)).numpy()
        np.save(root / "new_joint_vecs" / f"{name}.npy", rows)
        (root / "texts" / f"{name}.txt").write_text("A person Walks.#a/DET person/NOUN walk/VERB#0.0#0.0\n")
    (root / "train.txt").write_text("000001\nM000001\n000002\n")
    (root / "val.txt").write_text("000003\n")
    (root / "test.txt").write_text("000003\n")
    np.save(root / "Mean.npy", rows.mean(0))
    np.save(root / "Std.npy", np.ones(263, np.float32))
    return root


def test_a_humanml3d_folder_is_taken_as_it_comes(folder: Path, tmp_path: Path) -> None:
    got = load_clips(folder, ["train"], Augmentation(), tmp_path / "cache", 0)
    assert got.ids == ["000001", "M000001~m", "000002"] and got.lengths.tolist() == [79, 79, 69]
    for i, name in enumerate(("000001", "M000001", "000002")):
        rows = np.load(folder / "new_joint_vecs" / f"{name}.npy")
        assert torch.equal(got.features[got.starts[i] : got.starts[i + 1]], torch.from_numpy(rows))
    assert got.captions == [["a person walks."]] * 3
    assert got.terms()[0].startswith("non-commercial")
    plain = load_clips(folder, ["train"], Augmentation(mirror=False), tmp_path / "cache", 0)
    assert plain.ids == ["000001", "000002"] and not (tmp_path / "cache").exists()
    with pytest.raises(UserError, match="commercially"):
        load_clips(folder, ["train"], None, tmp_path / "cache", 0, commercial_only=True)


def test_everything_that_a_folder_lacks_is_named(folder: Path, tmp_path: Path) -> None:
    assert is_humanml3d(folder) and not is_humanml3d(walks(tmp_path / "walks"))
    (folder / "Mean.npy").unlink()
    shutil.rmtree(folder / "texts")
    with pytest.raises(UserError, match=r"lacks texts, Mean\.npy;"):
        train("tokenizer", folder, "paper", tmp_path / "run")
    (tmp_path / "empty").mkdir()
    with pytest.raises(UserError) as error:
        train("all", tmp_path / "empty", "paper", tmp_path / "run")
    assert all(name in str(error.value) for name in (*HUMANML3D, "motions_20fps.npz", "clips.jsonl"))
    with pytest.raises(UserError, match="does not exist"):
        train("all", tmp_path / "absent", "paper", tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_without_clip_one_is_told_what_to_do(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"names? one that holds CLIP.*--text"):
        train("all", folder, "paper", tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_every_stage_trains_on_humanml3d_with_another_text_encoder(folder: Path, tmp_path: Path) -> None:
    """As `--config paper --text minilm` does it: the transformer takes the encoder's width."""
    path = tmp_path / "paper.toml"
    path.write_text(TINY.replace('"none"', '"clip"').replace("text_dim = 1", "text_dim = 512"))
    run = train("all", folder, path, tmp_path / "run", text="none")
    curve = json.loads((run / "transformer" / "curve.json").read_text())
    assert [p["iteration"] for p in curve] == [2, 4] and all(np.isfinite(p["loss"]) for p in curve)
    about = read_about(run / "weights" / "transformer.safetensors")
    assert about["config"]["text"] == "none" and about["config"]["transformer"]["text_dim"] == 1
    assert about["licence"].startswith("non-commercial") and "HumanML3D" in about["credits"][0]
