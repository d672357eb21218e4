"""Robots' files: MJCF and URDF of the same robot are the same robot."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from scenectl.retarget.robots.humanoid import SPEED
from scenectl.retarget.robots.robot import Robot
from scenes.errors import UserError
from tests.scenectl.retarget.robots.humanoids import mjcf, person, saved, urdf, walking


def test_a_urdf_is_the_robot_that_its_mjcf_is(tmp_path: Path) -> None:
    one = Robot(saved(tmp_path, mjcf(person())), speed=12.0)
    two = Robot(saved(tmp_path, urdf(person()), "small.urdf"))
    three = Robot(saved(tmp_path, urdf(person()), "urdf.xml"))
    assert one.names == two.names == three.names and one.joints == two.joints and not two.doubts
    assert np.allclose(one.ranges, two.ranges) and np.array_equal(one.speeds, two.speeds)
    assert two.stated.all() and not one.stated.any()
    assert (Robot(one.source).speeds == SPEED).all()
    for name, place in one.points.at.items():
        assert np.allclose(place, two.points.at[name], atol=1e-6), name
    motion = walking(1.0)
    assert np.allclose(one.retarget(motion).qpos, two.retarget(motion).qpos, atol=2e-3)


def test_the_root_gets_a_free_joint_and_stands_alone(tmp_path: Path) -> None:
    props = '<geom type="plane" size="5 5 0.1"/><body name="crate"><freejoint/><geom type="box" size="1 1 1"/></body>'
    bare = Robot(saved(tmp_path, mjcf(person())))
    for free in (True, False):
        robot = Robot(saved(tmp_path, mjcf(person(), free, extra=props)))
        assert robot.root == "pelvis" and robot.names == bare.names and robot.model.nq == 7 + len(bare.names)
        assert robot.model.nbody == bare.model.nbody and "stands beside it" in robot.doubts[0]
        assert robot.points.legs == pytest.approx(bare.points.legs)


def test_meshes_that_are_missing_hinder_nothing(tmp_path: Path) -> None:
    bare = Robot(saved(tmp_path, mjcf(person())))
    shell = '<geom type="mesh" mesh="shell" contype="0" conaffinity="0"/>'
    texts = (
        (mjcf(person(), mesh=shell), "shell.xml"),
        (urdf(person(), mesh="package://small/shell.stl"), "shell.urdf"),
        (urdf(person(), mesh="shell.stl"), "beside.urdf"),
    )
    for text, name in texts:
        robot = Robot(saved(tmp_path, text, name))
        assert (
            len(robot.doubts) == 1 and "1 mesh files are missing" in robot.doubts[0] and "shell.stl" in robot.doubts[0]
        )
        assert robot.names == bare.names and robot.points.legs == pytest.approx(bare.points.legs)
    trimesh.creation.icosphere(radius=0.1).export(tmp_path / "shell.stl")
    for text, name in texts:
        robot = Robot(saved(tmp_path, text, name))
        assert not robot.doubts and robot.model.nmesh == 1


def test_what_names_a_floor_that_is_left_out_is_left_out_too(tmp_path: Path) -> None:
    floor = '<geom name="floor" type="plane" size="5 5 0.1"/>'
    more = (
        '<contact><pair geom1="floor" geom2="sole"/></contact>'
        '<sensor><framepos objtype="geom" objname="floor"/><jointpos joint="left_knee_joint"/></sensor></mujoco>'
    )
    text = mjcf(person(), extra=floor).replace('<geom type="box"', '<geom name="sole" type="box"', 1)
    assert Robot(saved(tmp_path, text.replace("</mujoco>", more))).names == Robot(saved(tmp_path, mjcf(person()))).names


@pytest.mark.parametrize("ending", ["stl", "dae", "glb"])
def test_meshes_that_mujoco_cannot_read_are_read_by_us(ending: str, tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(radius=0.1)
    data = trimesh.exchange.stl.export_stl_ascii(ball) if ending == "stl" else ball.export(file_type=ending)
    (tmp_path / f"shell.{ending}").write_bytes(data.encode() if isinstance(data, str) else data)
    robot = Robot(saved(tmp_path, urdf(person(), mesh=f"shell.{ending}"), "small.urdf"))
    assert not robot.doubts and robot.model.nmesh == 1
    assert np.abs(robot.model.mesh_vert).max() == pytest.approx(0.1, abs=0.01)


def test_urdfs_as_they_are_found(tmp_path: Path) -> None:
    plain = Robot(saved(tmp_path, urdf(person()), "plain.urdf"))
    text = urdf(person())
    text = text.replace('ixx="0.01" iyy="0.01" izz="0.01"', 'ixx="0" iyy="0.01" izz="0.01"', 2)
    text = text.replace(
        "<collision>", '<collision><geometry><sphere radius="0.0"/></geometry></collision><collision>', 2
    )
    text = text.replace("<origin xyz=", '<origin rpy="0, 0 0" xyz=', 3)
    found = Robot(saved(tmp_path, text, "found.urdf"))
    assert found.names == plain.names and found.points.legs == pytest.approx(plain.points.legs)


def test_flat_meshes_and_bodies_without_names(tmp_path: Path) -> None:
    trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]], [[0, 1, 2], [1, 3, 2]]).export(
        tmp_path / "shell.stl"
    )
    shell = '<geom type="mesh" mesh="shell" contype="0" conaffinity="0"/>'
    assert Robot(saved(tmp_path, mjcf(person(), mesh=shell))).model.nmesh == 1
    nameless = Robot(saved(tmp_path, mjcf(person()).replace('name="pelvis"', "").replace('name="waist_yaw_joint"', "")))
    assert nameless.joints["pelvis"] == nameless.root != "" and all(nameless.names)


def test_what_is_tied_and_what_has_no_feet_is_told(tmp_path: Path) -> None:
    tie = '<equality><joint joint1="left_knee_joint" joint2="left_ankle_pitch_joint"/></equality></mujoco>'
    assert "ties joints" in Robot(saved(tmp_path, mjcf(person()).replace("</mujoco>", tie))).doubts[0]
    bare = [replace(link, box=None) if "ankle" in link.name else link for link in person()]
    assert "feet have no shapes" in Robot(saved(tmp_path, mjcf(bare))).doubts[0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<mujoco><worldbody/></mujoco>", "has no bodies"),
        ("<mujoco><worldbody><body><geom/></body></worldbody></mujoco>", "cannot be read by MuJoCo"),
        ("<mujoco", "not valid XML"),
        ("<sdf/>", "has the root <sdf>"),
        ('<!DOCTYPE x [<!ENTITY a "b">]><mujoco/>', "DOCTYPE"),
        (mjcf(person()).replace('axis="0.0 0.0 1.0"', 'type="ball"', 1), "is not|ball joint|MuJoCo"),
        (urdf(person()).replace('lower="-', 'lower="${-pi', 1), "xacro"),
        ("<robot name='x'/>", "cannot be read by MuJoCo|has no bodies"),
    ],
)
def test_what_is_no_robot_is_said_in_one_sentence(text: str, said: str, tmp_path: Path) -> None:
    path = saved(tmp_path, text)
    with pytest.raises(UserError, match=said) as error:
        Robot(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


def test_no_file_and_no_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UserError, match=r"robot file '.*none.xml'"):
        Robot(tmp_path / "none.xml")
    path = saved(tmp_path, mjcf(person()))
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(UserError, match=r"robots need 'mujoco'; pip install 'scenectl\[robots\]'"):
        Robot(path)
