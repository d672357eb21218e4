"""NumPy archives as the programs read them that they were written for; what those do is written out here."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scenectl.export.animation import Animation
from scenectl.export.export import export
from scenectl.export.names import PRESETS, named
from scenes.body.body import DEFAULT_BODY, ProxyBody
from scenes.errors import UserError
from scenes.mesh.scale import TO_Y_UP
from scenes.motion.bones import rest_pose
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D
from tests.scenectl.export.moving import moving

SMPLX = (
    "Pelvis L_Hip R_Hip Spine1 L_Knee R_Knee Spine2 L_Ankle R_Ankle Spine3 L_Foot R_Foot Neck L_Collar R_Collar Head",
    "L_Shoulder R_Shoulder L_Elbow R_Elbow L_Wrist R_Wrist",
)
"""The order of holosoma_retargeting's format "smplx" (its config_types/data_type.py)."""
PELVIS = (0.5, -0.5, -0.5, -0.5)
"""What GMR's ik_configs/smplx_to_g1.json turns a person's pelvis by to get that of a G1, whose x is ahead and z up."""


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(("fps", "up", "unit"), [(20.0, None, None), (30.0, "y", "cm"), (60.0, "z", "m")])
def test_joints_are_read_as_holosoma_reads_them(
    preset: str, fps: float, up: str | None, unit: str | None, tmp_path: Path
) -> None:
    motion = moving(24)
    export(motion, tmp_path / "x.npz", fps=fps, names=preset, up=up, unit=unit)
    human_data = np.load(str(tmp_path / "x.npz"))  # nothing pickled is read
    joints, height = human_data["global_joint_positions"], human_data["height"]
    made, metres = named(Animation.of(motion)[0].resampled(fps), preset), 0.01 if unit == "cm" else 1.0
    assert joints.shape == made.joints.shape and height.shape == () and human_data["fps"] == fps
    assert np.abs(joints * metres @ TO_Y_UP[up or "z"].T - made.joints).max() < 1e-5
    assert height * metres == pytest.approx(DEFAULT_BODY.height * motion.skeleton.legs / HUMANML3D.legs)
    assert human_data["joint_names"].tolist() == list(made.skeleton.names)


def test_our_order_is_that_of_smplx() -> None:
    ours = [name.replace("left_", "L_").replace("right_", "R_").lower() for name in HUMANML3D.names]
    assert ours == [name.lower() for name in " ".join(SMPLX).split()]


@pytest.mark.parametrize("stature", [1.3, 1.95])
def test_heights_are_those_of_people(stature: float, tmp_path: Path) -> None:
    skeleton = ProxyBody.human(stature).skeleton
    export(moving(5, skeleton=skeleton), tmp_path / "x.npz", names="unreal")
    assert float(np.load(tmp_path / "x.npz")["height"]) == pytest.approx(stature, abs=0.01)


def test_bodies_are_read_as_gmr_wants_them(tmp_path: Path) -> None:
    motion = moving(24)
    export(motion, tmp_path / "x.npz", layout="bodies")
    data, made = np.load(tmp_path / "x.npz"), Animation.of(motion)[0]
    for t in (0, 9, 23):
        bodies = zip(data["body_positions"][t], data["body_rotations"][t], strict=True)
        frame = dict(zip(data["body_names"].tolist(), bodies, strict=True))
        assert set(frame) == set(HUMANML3D.names)
        for joint, parent in enumerate(HUMANML3D.parents):
            place, _ = frame[HUMANML3D.names[joint]]
            assert np.abs(TO_Y_UP["z"] @ place - motion.joints[t, joint].numpy()).max() < 1e-5
            if parent >= 0:  # frames of SMPL-X's joints have their T-pose y up, in a world with z up
                above, turned = frame[HUMANML3D.names[parent]]
                bone = Rotation.from_quat(turned, scalar_first=True).apply(made.skeleton.offsets[joint])
                assert np.abs(above + bone - place).max() < 1e-5


def test_a_g1_that_gmr_turns_stands_upright_and_looks_where_the_person_does(tmp_path: Path) -> None:
    standing = Motion(rest_pose(HUMANML3D).float().expand(5, 22, 3).clone())
    export(standing, tmp_path / "x.npz", layout="bodies")
    data = np.load(tmp_path / "x.npz")
    pelvis = Rotation.from_quat(data["body_rotations"][0, 0], scalar_first=True)
    robot = pelvis * Rotation.from_quat(PELVIS, scalar_first=True)
    np.testing.assert_allclose(robot.apply([[1, 0, 0], [0, 0, 1]]), [[0, -1, 0], [0, 0, 1]], atol=1e-6)
    ankle, foot = data["body_positions"][0, HUMANML3D.indices(("left_ankle", "left_foot"))]
    assert foot[1] - ankle[1] < -0.1


def test_other_layouts_are_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="unknown layout 'bodis'; did you mean 'bodies'"):
        export(moving(5), tmp_path / "x.npz", layout="bodis")
    assert not list(tmp_path.iterdir())
