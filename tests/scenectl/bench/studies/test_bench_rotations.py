"""Rotations are measured on clips, on files as they are, and where the truth is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch

from scenectl.bench.studies.rotations import animated, bench_rotations
from scenectl.data.collection import write_collection
from scenes.motion.motion import Motion
from tests.scenectl.small import walk


def test_every_kind_of_motion_has_its_rows(tmp_path: Path) -> None:
    rows = {f"c{i}": (Motion(walk(40 + i)), {"captions": "a person walks", "split": "test"}) for i in range(3)}
    write_collection(tmp_path / "clips", rows)
    sound = animated(40, seed=0)[1]
    off = sound.joints.clone()
    off[:, 15] += 0.01  # a head that is off its neck
    sound.save(tmp_path / "sound.npz")
    replace(sound, joints=off).save(tmp_path / "off.npz")
    files = [tmp_path / "sound.npz", tmp_path / "off.npz"]
    result = bench_rotations(tmp_path / "clips", animated=2, files=files)
    recorded, *joints, good, bad = result["rows"]
    assert recorded["motions"] == 3 and recorded["frames"] == 3 * 41 and recorded["flips"] == recorded["flipped"] == 0
    assert {row["set"] for row in joints} == {"animated"} and len(joints) == 17 and joints[0]["median_deg"] < 0.01
    assert good["fk_m"] < 1e-4 and bad["fk_m"] > 1e-3
    assert result["summary"]["largest_fk_error_m"] == bad["fk_m"]


def test_animated_bodies_are_rigid_and_move_smoothly() -> None:
    truth, motion = animated(100, seed=4)
    torch.testing.assert_close(truth @ truth.mT, torch.eye(3, dtype=torch.float64).expand_as(truth))
    assert motion.joints.diff(dim=0).norm(dim=-1).max() < 0.5
