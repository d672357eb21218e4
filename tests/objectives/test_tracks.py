"""Positions as functions of time."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from objectives import Arc, ArrayTrack, Line, Sinusoid, Term, WaypointTrack
from objectives.tracks import held_position
from scenes.errors import UserError


def at(track: Any, *times: float) -> list[list[float]]:
    return track.position(torch.tensor(times, dtype=torch.float64))[:, 0].tolist()


def test_line_runs_at_constant_speed_and_is_held() -> None:
    line = Line(start=(0, 1, 0), end=(2, 1, 4), times=(1, 3))
    assert at(line, 0, 1, 1.5, 3, 9) == [[0, 1, 0], [0, 1, 0], [0.5, 1, 1], [2, 1, 4], [2, 1, 4]]
    assert line.active(torch.tensor([0.9, 1.0, 3.0, 3.1]))[:, 0].tolist() == [False, True, True, False]


def test_arc_angles_are_headings() -> None:
    arc = Arc(center=(1, 2, 3), radius=0.5, angles=(0, math.pi), times=(0, 2))
    assert np.allclose(at(arc, 0, 1, 2), [[1, 2, 3.5], [1.5, 2, 3], [1, 2, 2.5]])


def test_sinusoid_waves_across_its_line() -> None:
    wave = Sinusoid(start=(0, 1, 0), end=(0, 1, 4), amplitude=(0.3, 0, 0), cycles=2, times=(0, 4))
    assert np.allclose(at(wave, 0, 0.5, 1, 1.5, 4), [[0, 1, 0], [0.3, 1, 0.5], [0, 1, 1], [-0.3, 1, 1.5], [0, 1, 4]])


def test_waypoints_agree_with_numpy() -> None:
    knots, points = [0.5, 1.0, 2.5], np.array([[0, 0, 0], [1, 2, 3], [-1, 0, 4.0]])
    track = WaypointTrack(times=knots, positions=points.tolist())
    times = np.linspace(0, 3, 50)
    expected = np.stack([np.interp(times, knots, points[:, axis]) for axis in range(3)], axis=-1)
    assert np.allclose(at(track, *times), expected)
    assert at(WaypointTrack(times=[1.0], positions=[(1, 2, 3)]), 0, 5) == [[1, 2, 3]] * 2


def test_array_hits_its_samples_and_leaves_gaps_free() -> None:
    positions = np.arange(12.0).reshape(4, 3)
    positions[2] = np.nan
    track = ArrayTrack(positions=positions, fps=10, begin=1.0)
    times = torch.tensor([0.9, 1.0, 1.05, 1.1, 1.15, 1.2, 1.3, 1.4])
    assert track.active(times)[:, 0].tolist() == [False, True, True, True, False, False, True, False]
    assert np.allclose(track.position(times[1:4])[:, 0], [positions[0], positions[:2].mean(0), positions[1]])


@pytest.mark.parametrize("name", ["track.npy", "track.npz"])
def test_files_lie_beside_the_task(name: str, tmp_path: Path) -> None:
    positions, mask = np.random.default_rng(0).normal(size=(5, 2, 3)), np.array([[1, 1]] * 4 + [[0, 1]])
    if name.endswith("z"):
        np.savez(tmp_path / name, positions=positions, mask=mask)
    else:
        np.save(tmp_path / name, positions)
    table = {"use": "joint_target", "joint": ["head", "pelvis"], "track": {"kind": "array", "file": name}}
    track = Term.from_table(table, tmp_path).parameters["track"]
    assert np.allclose(track.samples[0][:4], positions[:4])
    assert track.samples[1].sum() == (9 if name.endswith("z") else 10)


def test_bad_tracks_are_one_sentence(tmp_path: Path) -> None:
    np.save(tmp_path / "flat.npy", np.zeros((5, 2)))
    np.savez(tmp_path / "other.npz", poses=np.zeros((5, 3)))
    (tmp_path / "text.npy").write_text("hello")
    np.save(tmp_path / "object.npy", np.array([{}], dtype=object), allow_pickle=True)
    np.save(tmp_path / "complex.npy", np.zeros((5, 3), complex))
    np.savez(tmp_path / "mask.npz", positions=np.zeros((5, 3)), mask=np.array(["yes"] * 5))
    (tmp_path / "cut.npz").write_bytes((tmp_path / "mask.npz").read_bytes()[:300])
    cases: list[tuple[dict[str, Any], str]] = [
        ({"kind": "array", "file": "complex.npy"}, "must hold numbers"),
        ({"kind": "array", "file": "mask.npz"}, "has a mask of the type <U3"),
        ({"kind": "array", "file": "cut.npz"}, "is not an .npy or .npz file of numbers"),
        ({"kind": "array", "file": "none.npy"}, "does not exist"),
        ({"kind": "array", "file": "flat.npy"}, r"shape \[T, 3\] or \[T, n, 3\], not \(5, 2\)"),
        ({"kind": "array", "file": "other.npz"}, "no array 'positions' or 'joints', it holds poses"),
        ({"kind": "array", "file": "text.npy"}, "is not an .npy or .npz file of numbers"),
        ({"kind": "array", "file": "object.npy"}, "is not an .npy or .npz file of numbers"),
        ({"kind": "array"}, "needs either 'file' or 'positions'"),
        ({"kind": "array", "positions": [[0, 0, 0]], "mask": [False]}, "states no position"),
        ({"kind": "line", "start": [0, 0, 0], "end": [1, 0, 0], "times": [2, 1]}, "times must increase"),
        ({"kind": "line", "start": [0, 0, 0], "end": [1, 0, 0]}, "'times' is missing"),
        ({"kind": "line", "strat": [0, 0, 0]}, "unknown key 'strat'; did you mean 'start'"),
        ({"kind": "loop"}, "waypoints"),
        ({"kind": "waypoints", "times": [0, 1], "positions": [[0, 0, 0]]}, "2 times for 1 positions"),
        ({"kind": "arc", "center": [0, 0, 0], "radius": -1, "angles": [0, 1], "times": [0, 1]}, "greater than 0"),
    ]
    for table, expected in cases:
        with pytest.raises(UserError, match=expected) as caught:
            Term.from_table({"use": "joint_target", "track": table}, tmp_path)
        assert str(caught.value).startswith("goal 'joint_target': parameter 'track'")
        assert "\n" not in str(caught.value)


def test_obstacles_are_somewhere_at_every_time() -> None:
    times = torch.tensor([0.0, 1.0])
    with pytest.raises(UserError, match="no masked"):
        held_position(ArrayTrack(positions=np.array([[0, 0, 0], [np.nan, 0, 0]])), times)
    with pytest.raises(UserError, match="one point, this one has 2"):
        held_position(ArrayTrack(positions=np.zeros((3, 2, 3))), times)
