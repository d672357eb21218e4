"""MJCF robots: what MuJoCo compiles, as links and triangles; told apart from URDF; errors in one sentence."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from scenectl.data.characters import load_character
from scenes.body.mjcf import read_mjcf, read_robot, root_tag
from scenes.body.proxies import fit_proxies
from scenes.body.urdf import read_urdf
from scenes.errors import UserError

ARM = """<?xml version="1.0"?>
<!-- <robot> it is not -->
<mujoco model="arm">
  <asset><mesh name="tip" vertex="0 0 0  0.1 0 0  0 0.2 0  0 0 0.3"/></asset>
  <worldbody>
    <geom type="plane" size="5 5 0.1"/>
    <geom type="box" size="9 9 0.1" pos="0 0 -3"/>
    <body name="base" pos="1 2 0.5" quat="0.70710678 0 0 0.70710678">
      <geom type="box" size="0.1 0.2 0.3"/>
      <body name="upper" pos="0 0 0.5">
        <joint axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0  0.4 0 0" size="0.05"/>
        <geom name="shell" type="sphere" size="0.04" contype="0" conaffinity="0"/>
        <body pos="0.4 0 0">
          <joint axis="0 1 0"/>
          <geom type="cylinder" size="0.03 0.1" euler="0 90 0"/>
          <body name="hand" pos="0.1 0 0">
            <geom type="mesh" mesh="tip"/>
            <body name="ball"><geom type="ellipsoid" size="0.1 0.2 0.3" contype="0" conaffinity="0"/></body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>"""


def written(folder: Path, text: str = ARM, name: str = "arm.xml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_bodies_become_links_in_a_world_with_y_up(tmp_path: Path) -> None:
    rig = read_mjcf(written(tmp_path))
    assert rig.links == ("base", "upper", "body 3", "hand", "ball") and rig.parents == (-1, 0, 1, 2, 3)
    # MuJoCo's (x, y, z) is (y, z, x) here; the base is turned a quarter round, from x to y
    np.testing.assert_allclose(rig.origins[:3], [[2, 0.5, 1], [2, 1.0, 1], [2.4, 1.0, 1]], atol=1e-7)
    for frame in rig.frames:
        np.testing.assert_allclose(frame[:3, :3] @ frame[:3, :3].T, np.eye(3), atol=1e-9)
        assert np.linalg.det(frame[:3, :3]) > 0
    assert float(rig.triangles[..., 1].min()) == pytest.approx(0.2)  # the floor and the box below are no part of it


def test_every_shape_has_its_volume_where_it_is(tmp_path: Path) -> None:
    rig = read_mjcf(written(tmp_path))
    volumes = {
        "base": 0.2 * 0.4 * 0.6,
        "upper": math.pi * 0.05**2 * (0.4 + 4 / 3 * 0.05),
        "body 3": math.pi * 0.03**2 * 0.2,
        "hand": 0.1 * 0.2 * 0.3 / 6,
        "ball": 4 / 3 * math.pi * 0.1 * 0.2 * 0.3,
    }
    assert [part.link for part in rig.parts] == list(volumes)
    for part in rig.parts:
        mesh = trimesh.Trimesh(part.placed, part.faces)
        assert mesh.volume == pytest.approx(volumes[part.link], rel=0.02), part.link
    hand = rig.parts[3]
    np.testing.assert_allclose(np.sort(hand.vertices, axis=0)[-1], [0.1, 0.2, 0.3], atol=1e-6)


def test_what_only_shows_is_left_out_and_told_where_it_reaches_beyond(tmp_path: Path) -> None:
    assert read_mjcf(written(tmp_path)).doubts == ()
    large = read_mjcf(written(tmp_path, ARM.replace('size="0.04"', 'size="0.2"')))
    (doubt,) = large.doubts
    assert "1 of 1 visual shapes of link 'upper' (shell) reach up to 0.15 m" in doubt
    assert len(large.parts[1].vertices) == len(read_mjcf(written(tmp_path)).parts[1].vertices)


def test_one_robot_reads_alike_from_either_format(tmp_path: Path) -> None:
    urdf = written(
        tmp_path,
        """<robot name="r"><link name="a"><collision><origin xyz="0 0 0.1" rpy="0.3 0.2 0.1"/><geometry>
        <box size="0.1 0.2 0.3"/></geometry></collision></link>
        <link name="b"><collision><geometry><cylinder radius="0.1" length="0.5"/></geometry></collision></link>
        <joint name="j" type="fixed"><parent link="a"/><child link="b"/><origin xyz="0.1 0.2 0.3" rpy="0 1 0"/></joint>
        </robot>""",
        "r.xml",
    )
    mjcf = written(
        tmp_path,
        """<mujoco><compiler angle="radian" eulerseq="XYZ"/><worldbody><body name="a">
        <geom type="box" size="0.05 0.1 0.15" pos="0 0 0.1" euler="0.3 0.2 0.1"/>
        <body name="b" pos="0.1 0.2 0.3" euler="0 1 0"><geom type="cylinder" size="0.1 0.25"/></body>
        </body></worldbody></mujoco>""",
    )
    ours, theirs = read_robot(mjcf), read_robot(urdf)
    assert ours.links == theirs.links and theirs.name == "r"
    np.testing.assert_allclose(ours.triangles, theirs.triangles, atol=1e-9)


def test_capsules_are_fitted_to_it(tmp_path: Path) -> None:
    proxies = fit_proxies(load_character(written(tmp_path))[0])
    assert proxies.uncovered < 1e-6
    (upper,) = (part for part in proxies.parts if part.link == "upper")
    assert upper.capsules[0].radius == pytest.approx(0.05, rel=0.02) and upper.volume_ratio == pytest.approx(
        1, rel=0.05
    )


@pytest.mark.parametrize(
    ("text", "tag"),
    [
        ("<robot name='a'/>", "robot"),
        ("\ufeff<?xml version='1.0'?>\n<!-- <mujoco> -->\n<robot/>", "robot"),
        ("<!-- a --><!-- <robot> --> <mujoco model='b'>", "mujoco"),
        ("<!DOCTYPE robot><mujoco/>", "mujoco"),
        ("", ""),
        ("no xml", ""),
    ],
)
def test_files_are_told_apart_by_their_first_element(tmp_path: Path, text: str, tag: str) -> None:
    assert root_tag(written(tmp_path, text)) == tag


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<mujoco", "is refused by MuJoCo: XML parse error"),
        ("<mujoco/>", "has no bodies"),
        ("<mujoco><worldbody><body/></worldbody></mujoco>", "has no shapes on its bodies"),
        ("<mujoco><worldbody><body><geom size='-1'/></body></worldbody></mujoco>", "size 0 must be positive"),
        ("<mujoco><worldbody><body><geom size='1' pos='9e9 0 0'/></body></worldbody></mujoco>", "check its size"),
        ("<mujoco><asset><mesh file='gone.stl'/></asset></mujoco>", "gone.stl"),
        ("<mujoco><include file='gone.xml'/></mujoco>", "gone.xml"),
        ("<sdf><model/></sdf>", "its root is <sdf>"),
    ],
)
def test_bad_files_are_told_in_one_sentence(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(UserError) as told:
        read_robot(written(tmp_path, text))
    assert "arm.xml" in str(told.value) and said in str(told.value) and "\n" not in str(told.value)


def test_where_mujoco_is_missing_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(UserError, match=r"scenectl\[robots\]"):
        read_robot(written(tmp_path))
    assert read_urdf(written(tmp_path, "<robot><link name='l'><collision><geometry><sphere radius='1'/></geometry>"
                                       "</collision></link></robot>", "r.urdf")).links == ("l",)  # fmt: skip
