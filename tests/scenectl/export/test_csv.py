"""CSV as Python's own reader sees it."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scenectl.data.formats.people import UNITS
from scenectl.export.animation import Animation
from scenectl.export.export import export
from scenectl.export.names import PRESETS, named
from scenes.mesh.scale import TO_Y_UP
from tests.scenectl.export.moving import moving


def columns(path: Path) -> dict[str, np.ndarray]:
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(
    ("fps", "up", "unit"), [(20.0, "y", None), (30.0, "z", "cm"), (60.0, "z", "mm"), (20.0, "y", "ft")]
)
def test_another_reader_finds_joints_within_a_millimetre(
    preset: str, fps: float, up: str, unit: str | None, tmp_path: Path
) -> None:
    motion = moving(24, seed=3)
    export(motion, tmp_path / "x.csv", fps=fps, names=preset, up=up, unit=unit)
    made, table, unit = named(Animation.of(motion)[0].resampled(fps), preset), columns(tmp_path / "x.csv"), unit or "m"
    np.testing.assert_allclose(table["time_s"], np.arange(made.frames) / fps, atol=1e-6)
    assert len(table) == 1 + 7 * len(made.skeleton.names)
    places, turns = [], []
    for name in made.skeleton.names:
        places.append(np.stack([table[f"{name}_{axis}_{unit}"] for axis in "xyz"], axis=-1) * UNITS[unit])
        quaternions = np.stack([table[f"{name}_q{part}"] for part in "wxyz"], axis=-1)
        assert np.abs(np.diff(quaternions, axis=0)).max() < 0.7
        np.testing.assert_allclose((quaternions**2).sum(-1), 1, atol=1e-5)
        turns.append(Rotation.from_quat(quaternions, scalar_first=True))
    back = np.stack(places, axis=1) @ TO_Y_UP[up].T
    assert np.linalg.norm(back - made.joints, axis=-1).max() < 1e-4
    shared = [(k, round(k * 20 / fps)) for k in range(made.frames) if (k * 20) % fps == 0]
    assert len(shared) > 10
    for frame, original in shared:
        assert np.linalg.norm(back[frame, made.ours] - motion.joints[original].numpy(), axis=-1).max() < 1e-3
    for joint, parent in list(enumerate(made.skeleton.parents))[2:]:  # rotations carry the T-pose in the file's axes
        bone = turns[parent].apply(np.array(made.skeleton.offsets[joint]) @ TO_Y_UP[up])
        assert np.linalg.norm(places[parent] + bone - places[joint], axis=-1).max() < 1e-4
