"""Which bodies of a robot move as which of our joints."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenectl.retarget.robots.humanoid import Humanoid
from scenectl.retarget.robots.mapping import NAMES
from scenes.errors import UserError
from tests.scenectl.retarget.robots.humanoids import Link, X, Y, mjcf, person, renamed, saved

TOLD = {f"{side}_{part}": f"{side}_{body}" for side in ("left", "right") for part, body in {
    "hip": "hip_yaw_link", "knee": "knee_link", "ankle": "ankle_roll_link", "shoulder": "shoulder_yaw_link",
    "elbow": "elbow_link", "wrist": "wrist_link",
}.items()} | {"pelvis": "pelvis", "spine3": "torso_link"}  # fmt: skip


def other_names(style: dict[str, str]) -> list[Link]:
    """The person's links with words replaced, and sides as the style has them."""

    def name(text: str) -> str:
        for word, new in style.items():
            text = text.replace(word, new)
        return text

    return [replace(link, name=name(link.name), parent=name(link.parent)) for link in person()]


@pytest.mark.parametrize(
    "style",
    [
        {},
        {"left_": "L_", "right_": "R_"},
        {"left_": "Left", "right_": "Right", "hip": "Hip", "knee": "Knee", "ankle": "Ankle", "elbow": "Elbow"},
        {
            "hip_": "thigh_",
            "knee": "shin",
            "ankle": "foot",
            "shoulder": "upper_arm",
            "elbow": "forearm",
            "wrist": "hand",
        },
    ],
)
def test_names_tell(style: dict[str, str], tmp_path: Path) -> None:
    links = other_names(style)
    back = {new.name: old.name for new, old in zip(links, person(), strict=True)}
    robot = Humanoid(saved(tmp_path, mjcf(links)))
    assert {joint: back[body] for joint, body in robot.joints.items()} == TOLD and not robot.doubts


@pytest.mark.parametrize("turn", [0.0, 1.0, math.pi])
def test_geometry_tells_where_names_do_not(turn: float, tmp_path: Path) -> None:
    links = renamed(person())
    back = {new.name: old.name for new, old in zip(links, person(), strict=True)}
    robot = Humanoid(saved(tmp_path, mjcf(links, turn=turn)))
    assert {joint: back[body] for joint, body in robot.joints.items()} == TOLD
    assert len(robot.doubts) == 1 and "geometry" in robot.doubts[0]
    assert np.allclose(robot.points.turn[2], [math.cos(turn), math.sin(turn), 0], atol=1e-6), "its feet point ahead"


def test_hands_heads_and_fingers_are_seen(tmp_path: Path) -> None:
    more = [
        Link("head_link", "torso_link", (0, 0, 0.5), Y, box=((0, 0, 0.1), (0.1, 0.1, 0.1))),
        *(Link(f"left_hand_{finger}_link", "left_wrist_link", (0, y, -0.15), X) for finger, y in
          (("thumb", -0.02), ("index", 0.02))),
    ]  # fmt: skip
    robot = Humanoid(saved(tmp_path, mjcf([*person(), *more])))
    assert robot.joints == TOLD | {"head": "head_link"}


def hand(side: str, on: str) -> list[Link]:
    """Three fingers of three hinges each, as long as a forearm."""
    return [
        Link(f"{side}{finger}{joint}_link", on if joint == 0 else f"{side}{finger}{joint - 1}_link", (0, y, -0.09), X,
             box=((0, 0, -0.04), (0.01, 0.01, 0.04)))
        for finger, y in (("a", -0.03), ("b", 0.0), ("c", 0.03)) for joint in range(3)
    ]  # fmt: skip


def test_a_wrist_is_told_from_fingers_without_names(tmp_path: Path) -> None:
    links = [*person(), *(one for side in ("left", "right") for one in hand(side, f"{side}_wrist_link"))]
    named, told = (Humanoid(saved(tmp_path, mjcf(some), f"{i}.xml")) for i, some in enumerate((links, renamed(links))))
    assert named.tree.names.index(named.joints["left_wrist"]) == told.tree.names.index(told.joints["left_wrist"])
    assert told.points.length("left_elbow", "left_wrist") == pytest.approx(
        named.points.length("left_elbow", "left_wrist")
    )


def test_what_opens_a_hand_is_no_wrist(tmp_path: Path) -> None:
    links = [replace(link, name=link.name) for link in person()]
    links += [Link(f"{side}_hand_finger_link", f"{side}_wrist_link", (0, 0, -0.1), X) for side in ("left", "right")]
    text = mjcf(links).replace("left_hand_finger_joint", "LHand").replace("right_hand_finger_joint", "RHand")
    assert Humanoid(saved(tmp_path, text)).joints == TOLD


@pytest.mark.parametrize("style", ["before", "after"])
def test_sides_stick_to_words(style: str, tmp_path: Path) -> None:
    words = {"hip_yaw": "femur", "knee": "tibia", "ankle_roll": "foot", "shoulder_yaw": "humerus", "elbow": "radius",
             "wrist": "hand"}  # fmt: skip
    names = {}
    for link in person():
        side, _, part = link.name.removesuffix("_link").partition("_")
        if side in ("left", "right"):
            word = words.get(part, f"part{len(names)}")
            names[link.name] = f"{side[0]}{word}" if style == "before" else f"{word}{side[0]}"
    links = [replace(link, name=names.get(link.name, link.name), parent=names.get(link.parent, link.parent))
             for link in person()]  # fmt: skip
    robot = Humanoid(saved(tmp_path, mjcf(links)))
    assert robot.joints == {joint: names.get(body, body) for joint, body in TOLD.items()} and not robot.doubts


def test_knees_of_any_range_bend_ahead(tmp_path: Path) -> None:
    links = [replace(link, range=(-3.0, 3.0)) if "knee" in link.name else link for link in person()]
    flipped = [replace(link, axis=(0, -1, 0)) if link.name == "left_knee_link" else link for link in links]
    for number, some in enumerate((links, flipped)):
        robot = Humanoid(saved(tmp_path, mjcf(some), f"{number}.xml"))
        low, high = robot.bounds[:, robot.names.index("left_knee_joint")]
        assert (low > 0) == (number == 0) and (high < 0) == (number == 1)


def test_a_forearm_without_a_hand_ends_in_the_wrist(tmp_path: Path) -> None:
    links = [link for link in person() if "wrist" not in link.name]
    forearms = ((0, 0, -0.13), (0.03, 0.03, 0.14))
    links = [replace(link, box=forearms) if "elbow" in link.name else link for link in links]
    robot = Humanoid(saved(tmp_path, mjcf(links)))
    assert robot.joints["left_wrist"] == robot.joints["left_elbow"] == "left_elbow_link"
    assert robot.points.length("left_elbow", "left_wrist") == pytest.approx(0.27)


def test_axes_that_do_not_meet_meet_in_the_nearest_point(tmp_path: Path) -> None:
    spread = {"left_hip_roll_link": (0.0, 0.04, -0.02), "left_hip_yaw_link": (0.02, 0.0, -0.1)}
    links = [replace(link, offset=spread.get(link.name, link.offset)) for link in person()]
    robot = Humanoid(saved(tmp_path, mjcf(links)))
    first = next(link for link in links if link.name == "left_hip_pitch_link")
    there = np.array([first.offset[0] + 0.01, first.offset[1] + 0.04, first.offset[2] - 0.01])
    body, place = robot.points.bodies["left_hip"]
    assert robot.model.body(body).name == "pelvis" and np.allclose(place, there, atol=2e-3)


def test_what_is_stated_wins(tmp_path: Path) -> None:
    path, strange = saved(tmp_path, mjcf(person())), saved(tmp_path, mjcf(renamed(person())), "strange.xml")
    robot = Humanoid(path, {"left_wrist": "left_elbow_link", "spine3": "waist_roll_link"})
    assert robot.joints == TOLD | {"left_wrist": "left_elbow_link", "spine3": "waist_roll_link"}
    odd = Humanoid(strange, {"left_wrist": "part13_link"})
    assert odd.joints["left_wrist"] == "part13_link" and odd.joints["right_wrist"] == "part25_link"
    with pytest.raises(UserError, match=r"body 'left_hand', stated as left_wrist, is not in .*did you mean 'left_"):
        Humanoid(path, {"left_wrist": "left_hand"})
    with pytest.raises(UserError, match="our joint 'left_toe'"):
        Humanoid(path, {"left_toe": "pelvis"})
    with pytest.raises(UserError, match="don't hang on each other"):
        Humanoid(path, {"left_knee": "right_knee_link"})
    assert set(TOLD) | {"head"} == set(NAMES)


def quadruped() -> list[Link]:
    links = [Link("trunk", "", box=((0, 0, 0), (0.3, 0.1, 0.05)))]
    for x in (0.25, -0.25):
        for y in (0.12, -0.12):
            name = f"leg{len(links)}"
            links += [
                Link(f"{name}a_link", "trunk", (x, y, 0), X),
                Link(f"{name}b_link", f"{name}a_link", axis=Y),
                Link(f"{name}c_link", f"{name}b_link", (0, 0, -0.25), Y),
                Link(f"{name}d_link", f"{name}c_link", (0, 0, -0.25), Y, box=((0, 0, -0.02), (0.02, 0.02, 0.02))),
            ]
    return links


def test_what_is_no_humanoid_is_refused(tmp_path: Path) -> None:
    for number, links in enumerate((
        quadruped(),
        [link for link in person() if "left_" not in link.name],
        [link for link in person() if not any(part in link.name for part in ("shoulder", "elbow", "wrist"))],
        [Link("ball", "", box=((0, 0, 0), (1, 1, 1)))],
        [Link("palm", "", box=((0, 0, 0), (0.05, 0.05, 0.02))), *(
            Link(f"f{finger}{joint}_link", "palm" if joint == 0 else f"f{finger}{joint - 1}_link",
                 (0.05, 0.02 * finger, 0.0), Y, box=((0.02, 0, 0), (0.02, 0.005, 0.005)))
            for finger in range(5) for joint in range(4)
        )],
    )):  # fmt: skip
        with pytest.raises(UserError, match="no humanoid"):
            Humanoid(saved(tmp_path, mjcf(links), f"{number}.xml"))
