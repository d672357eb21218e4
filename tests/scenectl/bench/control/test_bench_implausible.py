"""Targets out of reach, on a statue that can be moved."""

from __future__ import annotations

from pathlib import Path

import torch

from scenectl.bench.control.implausible import KINDS, _asked, _names, _summary, bench_implausible
from scenes.motion.motion import Motion
from tests.scenectl.small import walk
from tests.scenectl.tiny import TinyGenerator
from tests.scenectl.training.folder import walks


def test_every_kind_is_made_both_ways(tmp_path: Path) -> None:
    result = bench_implausible(TinyGenerator(), walks(tmp_path), clips=1)
    rows, summary = result["rows"], result["summary"]
    assert [(row["kind"], row["way"]) for row in rows] == [(k, w) for k in KINDS for w in ("natural", "goals alone")]
    assert summary["cases"] == len(KINDS)
    rows = [{**row, "lift_m": 0.01 * i, "missed_m": 0.002 * i} for i, row in enumerate(rows)]  # all alike so far
    summary = _summary(rows)
    for way in ("natural", "goals alone"):
        assert 0 <= summary[way]["named"] <= 1 and summary[way]["median_seconds"] > 0
        mine = [row for row in rows if row["way"] == way]
        assert summary[way]["lift_m"] == max(row["lift_m"] for row in mine)
        assert all((row["spoilt_missed_m"] is None) == (row["kind"] == "noisy") for row in mine)
        sound = [row for row in mine if row["kind"] != "noisy"]
        assert summary[way]["others_met"] == sum(row["missed_m"] <= 0.01 for row in sound) / len(sound)


def test_one_target_is_spoilt_and_all_where_they_are_noise() -> None:
    real = Motion(walk(64))
    for kind in KINDS:
        ask = _asked(kind, real, torch.Generator().manual_seed(3))
        at = [round(20 * t) for t in ask.terms[0].times]
        position = ask.terms[0].parameters["position"]
        wanted = torch.tensor([[p.x, p.y, p.z] for p in position])
        off = (real.joint(str(ask.terms[0].parameters["joint"]))[at] - wanted).norm(dim=-1) > 1e-3
        spoilt = [number - 1 for term, number in ask.culprits if term == "joint_target"]
        if kind == "noisy":
            assert off.all() and not ask.culprits
        elif kind == "torn apart":
            assert not off.any() and len(ask.terms) == 2 and ("right hand", 1) in ask.culprits
        else:
            assert off.nonzero()[:, 0].tolist() == spoilt and 1 <= spoilt[0] <= 3


def test_a_culprit_is_named_by_its_number_and_first() -> None:
    said = (
        "target 3 (left wrist, 2.40 s) is 38 cm out of reach; met to 41 cm; target 1 (head, 1.00 s) is met to 2 cm only"
    )
    assert _names(said, "joint_target", 3)
    assert not _names(said, "joint_target", 1) and not _names(said.replace("3", "31", 1), "joint_target", 3)
    assert _names("right hand: the target (right wrist, 1.00 s) is met to 2 cm only", "right hand", 1)
