"""Trajectories in files, as they are and as others read them."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scenectl.retarget.robots.files import LAYOUTS, write
from scenectl.retarget.robots.robot import Robot
from scenectl.retarget.robots.trajectory import Trajectory
from scenes.errors import UserError
from tests.scenectl.retarget.robots.humanoids import dancing, mjcf, person, saved


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Trajectory:
    trajectory: Trajectory = Robot(saved(tmp_path_factory.mktemp("robot"), mjcf(person()))).retarget(dancing(), 30.0)
    return trajectory


def test_csv_names_what_it_holds(made: Trajectory, tmp_path: Path) -> None:
    write(made, tmp_path / "a.csv")
    with (tmp_path / "a.csv").open() as file:
        rows = [*csv.reader(file)]
    assert rows[0][:8] == ["time (s)", *(f"root {one}" for one in ("x (m)", "y (m)", "z (m)", "qw", "qx", "qy", "qz"))]
    assert rows[0][8:] == [f"{name} (rad)" for name in made.robot.names]
    numbers = np.array(rows[1:], float)
    assert np.allclose(numbers[:, 0], made.times) and np.allclose(numbers[:, 1:], made.qpos, atol=1e-7)


def test_csv_of_lafan1_has_no_header_and_w_last(made: Trajectory, tmp_path: Path) -> None:
    write(made, tmp_path / "a.csv", "lafan1")
    numbers = np.loadtxt(tmp_path / "a.csv", delimiter=",")
    assert np.allclose(numbers[:, 3:7], made.qpos[:, [4, 5, 6, 3]], atol=1e-7)
    assert np.allclose(numbers[:, :3], made.qpos[:, :3], atol=1e-7)
    assert np.allclose(numbers[:, 7:], made.qpos[:, 7:], atol=1e-7)


def test_npz_holds_it_all(made: Trajectory, tmp_path: Path) -> None:
    write(made, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as data:
        assert np.array_equal(data["qpos"], made.qpos) and data["fps"] == 30 and data["root"] == "pelvis"
        assert data["joint_names"].tolist() == [*made.robot.names]


def test_npz_of_gmr_places_bodies_in_the_roots_frame(made: Trajectory, tmp_path: Path) -> None:
    write(made, tmp_path / "a.npz", "gmr")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as data:
        turn = Rotation.from_quat(data["root_rot"]).as_matrix()
        names = data["link_body_list"].tolist()
        knee = (turn @ data["local_body_pos"][:, names.index("left_knee_link"), :, None])[..., 0] + data["root_pos"]
        assert np.allclose(knee, made.joint("left_knee"), atol=1e-9)
        assert np.array_equal(data["dof_pos"], made.qpos[:, 7:])


@pytest.mark.parametrize(("layout", "keys"), [
    ("mjlab", ("joint_pos", "joint_vel", "body_pos_w", "body_quat_w", "body_lin_vel_w", "body_ang_vel_w")),
    ("isaaclab", ("dof_positions", "dof_velocities", "body_positions", "body_rotations", "body_linear_velocities",
                  "body_angular_velocities")),
])  # fmt: skip
def test_velocities_are_those_of_what_moves(
    made: Trajectory, tmp_path: Path, layout: str, keys: tuple[str, ...]
) -> None:
    write(made, tmp_path / "a.npz", layout)
    with np.load(tmp_path / "a.npz", allow_pickle=False) as data:
        joints, rates, places, turns, speeds, spins = (data[key] for key in keys)
        assert float(np.squeeze(data["fps"])) == 30
    frames, bodies = made.frames, made.robot.model.nbody - 1
    assert joints.shape == rates.shape == (frames, len(made.robot.names))
    assert places.shape == speeds.shape == spins.shape == (frames, bodies, 3) and turns.shape == (frames, bodies, 4)
    middle = slice(1, -1)
    assert np.allclose(rates[middle] / 15, joints[2:] - joints[:-2], atol=1e-5)
    assert np.allclose(speeds[middle] / 15, places[2:] - places[:-2], atol=1e-5)
    for body in (0, bodies - 1):
        before, after = (
            Rotation.from_quat(turns[at, body], scalar_first=True) for at in (slice(0, -2), slice(2, None))
        )
        by = Rotation.from_rotvec(spins[middle, body] / 15)
        assert np.allclose((by * before).as_matrix(), after.as_matrix(), atol=1e-5)


def test_endings_and_layouts_that_are_not_written(made: Trajectory, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"ends with '.pkl'; trajectories are written as .csv or .npz"):
        write(made, tmp_path / "a.pkl")
    for ending, known in LAYOUTS.items():
        with pytest.raises(UserError, match=f"{ending} files have no layout 'gmrr'"):
            write(made, tmp_path / f"a{ending}", "gmrr")
        assert known[0] == "named"
    assert not [*tmp_path.iterdir()]
