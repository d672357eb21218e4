"""Small humanoids of the tests, as MJCF and as URDF of the same, and motions for them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import gaussian_filter1d

from scenes.body.body import DEFAULT_BODY
from scenes.motion.kinematics import forward
from scenes.motion.motion import Motion
from scenes.motion.rotations import about, unit_quaternions
from scenes.motion.skeleton import HUMANML3D

X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
AT = {name: np.zeros(3) for name in HUMANML3D.names}
for _parent, _joint in HUMANML3D.bones:
    AT[HUMANML3D.names[_joint]] = AT[HUMANML3D.names[_parent]] + HUMANML3D.offsets[_joint]


@dataclass(frozen=True)
class Link:
    """A link, where it is on its parent (m), the hinge that turns it, and a box: middle and halves of its sides."""

    name: str
    parent: str
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axis: tuple[int, int, int] | None = None
    range: tuple[float, float] = (-3.0, 3.0)
    box: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    speed: float = 12.0

    @property
    def joint(self) -> str:
        return self.name.replace("_link", "_joint")


def person(size: float = 1.0) -> list[Link]:
    """A robot of our own proportions, so many times as large, arms hanging, a hinge a link, ranges that people have."""

    def off(a: str, b: str) -> tuple[float, float, float]:
        x, y, z = (size * (AT[b] - AT[a])).tolist()
        return z, x, y

    def long(a: str, b: str) -> float:
        return size * float(np.linalg.norm(AT[b] - AT[a]))

    links = [Link("pelvis", "", box=((0, 0, 0.02), (0.06, 0.1, 0.05)))]
    sole = size * DEFAULT_BODY.sole_offset
    links.append(Link("waist_yaw_link", "pelvis", off("pelvis", "spine1"), Z, (-1.5, 1.5)))
    links.append(Link("waist_roll_link", "waist_yaw_link", axis=X, range=(-0.8, 0.8)))
    links.append(Link("torso_link", "waist_roll_link", axis=Y, range=(-0.8, 1.2), box=((0, 0, 0.2), (0.08, 0.12, 0.2))))
    for side, sign in (("left", 1), ("right", -1)):
        hip, knee, ankle, foot = (f"{side}_{part}" for part in ("hip", "knee", "ankle", "foot"))
        rise, ahead = float(AT[ankle][1] - AT[foot][1]) * size, float(AT[foot][2] - AT[ankle][2]) * size
        links += [
            Link(f"{hip}_pitch_link", "pelvis", off("pelvis", hip), Y, (-2.6, 1.5)),
            Link(f"{hip}_roll_link", f"{hip}_pitch_link", axis=X, range=tuple(sorted((-0.7 * sign, 1.5 * sign)))),
            Link(f"{hip}_yaw_link", f"{hip}_roll_link", axis=Z, range=(-1.5, 1.5)),
            Link(f"{knee}_link", f"{hip}_yaw_link", (0, 0, -long(hip, knee)), Y, (-0.1, 2.7)),
            Link(f"{ankle}_pitch_link", f"{knee}_link", (0, 0, -long(knee, ankle)), Y, (-1.2, 1.2)),
            Link(
                f"{ankle}_roll_link", f"{ankle}_pitch_link", axis=X, range=(-0.8, 0.8),
                box=(((ahead - 0.05) / 2, 0, -rise - sole + 0.01), ((ahead + 0.05) / 2, 0.04, 0.01)),
            ),
            Link(f"{side}_shoulder_pitch_link", "torso_link", off("spine1", f"{side}_shoulder"), Y, (-3.1, 1.8)),
            Link(
                f"{side}_shoulder_roll_link", f"{side}_shoulder_pitch_link", axis=X,
                range=tuple(sorted((-0.5 * sign, 3.1 * sign))),
            ),
            Link(f"{side}_shoulder_yaw_link", f"{side}_shoulder_roll_link", axis=Z, range=(-2.5, 2.5)),
            Link(
                f"{side}_elbow_link", f"{side}_shoulder_yaw_link",
                (0, 0, -long(f"{side}_shoulder", f"{side}_elbow")), Y, (-2.6, 0.2),
            ),
            Link(
                f"{side}_wrist_link", f"{side}_elbow_link", (0, 0, -long(f"{side}_elbow", f"{side}_wrist")), Z,
                (-1.5, 1.5), ((0, 0, -0.08), (0.02, 0.04, 0.08)),
            ),
        ]  # fmt: skip
    return links


def renamed(links: Sequence[Link]) -> list[Link]:
    """The same under names that tell nothing."""
    new = {link.name: f"part{number}_link" for number, link in enumerate(links)}
    return [replace(link, name=new[link.name], parent=new.get(link.parent, "")) for link in links]


def mjcf(
    links: Sequence[Link], free: bool = True, turn: float = 0.0, extra: str = "", mesh: str = "", quat: str = ""
) -> str:
    """An MJCF of links; `turn` (rad) turns the robot about z, `extra` stands beside it, `mesh` is on its root.

    `quat` turns it as is said there.
    """

    def body(link: Link) -> str:
        joint = "<freejoint/>" if free and not link.parent else ""
        if link.axis is not None:
            joint = f'<joint name="{link.joint}" axis="{_text(link.axis)}" range="{_text(link.range)}"/>'
        shape = "" if link.parent else mesh
        if link.box is not None:
            shape += f'<geom type="box" pos="{_text(link.box[0])}" size="{_text(link.box[1])}"/>'
        turned = quat or f"{math.cos(turn / 2)} 0 0 {math.sin(turn / 2)}"
        own = "" if link.parent else f'quat="{turned}"'
        inside = "".join(body(child) for child in links if child.parent == link.name)
        mass = '<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>'
        return f'<body name="{link.name}" pos="{_text(link.offset)}" {own}>{mass}{joint}{shape}{inside}</body>'

    asset = '<asset><mesh name="shell" file="shell.stl"/></asset>' if mesh else ""
    return (
        f'<mujoco model="small"><compiler angle="radian" autolimits="true"/>{asset}'
        f"<worldbody>{extra}{body(links[0])}</worldbody></mujoco>"
    )


def urdf(links: Sequence[Link], mesh: str = "") -> str:
    """A URDF of links, with speeds; `mesh` is the address of one that is seen on the root."""
    rows = []
    for link in links:
        rows.append(f'<link name="{link.name}"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ')
        rows.append('ixy="0" ixz="0" iyz="0"/></inertial>')
        if link.box is not None:
            size = [2 * half for half in link.box[1]]
            rows.append(f'<collision><origin xyz="{_text(link.box[0])}"/><geometry><box size="{_text(size)}"/>')
            rows.append("</geometry></collision>")
        if mesh and not link.parent:
            rows.append(f'<visual><geometry><mesh filename="{mesh}"/></geometry></visual>')
        rows.append("</link>")
        if link.parent:
            assert link.axis is not None
            low, high = link.range
            rows.append(
                f'<joint name="{link.joint}" type="revolute"><parent link="{link.parent}"/><child link="{link.name}"/>'
                f'<origin xyz="{_text(link.offset)}"/><axis xyz="{_text(link.axis)}"/>'
                f'<limit lower="{low}" upper="{high}" effort="50" velocity="{link.speed}"/></joint>'
            )
    return f'<robot name="small">{"".join(rows)}</robot>'


def saved(folder: Path, text: str, name: str = "small.xml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def _text(numbers: Sequence[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)


def dancing(seed: int = 0, frames: int = 40, fps: float = 20.0, most: float = 1.0) -> Motion:
    """One of our bodies that moves as `person` can: hips, knees, waist, shoulders and elbows, at random."""
    draw = np.random.default_rng(seed)

    def angle(low: float, high: float) -> torch.Tensor:
        smooth = gaussian_filter1d(draw.standard_normal(frames + 40), 0.3 * fps)[20:-20]
        share = 0.5 + 0.5 * np.tanh(smooth / 0.2)
        return torch.from_numpy(most * (low + (high - low) * share))

    turned = {name: torch.eye(3, dtype=torch.float64).expand(frames, 3, 3) for name in HUMANML3D.names}
    turned["pelvis"] = about(1, angle(-1.0, 1.0)) @ about(0, angle(-0.2, 0.2))
    turned["spine1"] = about(1, angle(-0.5, 0.5)) @ about(0, angle(-0.2, 0.6))
    for side, sign in (("left", 1), ("right", -1)):
        turned[f"{side}_hip"] = about(2, sign * angle(-0.1, 0.4)) @ about(0, angle(-1.0, 0.3))
        turned[f"{side}_knee"] = about(0, angle(0.3, 1.2))
        turned[f"{side}_shoulder"] = about(1, sign * angle(-0.6, 0.3)) @ about(2, sign * angle(-1.2, 0.2))
        turned[f"{side}_elbow"] = about(1, sign * angle(-1.5, -0.3))
    local = unit_quaternions(torch.stack([turned[name] for name in HUMANML3D.names], dim=1))
    root = torch.stack([angle(-0.3, 0.3), 1.0 + angle(-0.1, 0.1), angle(-0.3, 0.3)], dim=1)
    return Motion(forward(local, root, HUMANML3D), fps=fps)


def walking(seconds: float = 3.0, fps: float = 20.0, speed: float = 1.0, toes: float = 0.0) -> Motion:
    """A plain walk along +z: feet stand half of each second, flat or with toes turned out, and swing the other half."""
    frames = round(seconds * fps)
    times, sole = np.arange(frames) / fps, DEFAULT_BODY.sole_offset
    joints = np.stack([AT[name] for name in HUMANML3D.names])[None].repeat(frames, axis=0)
    joints[:, :, 2] += speed * times[:, None]
    joints[:, :, 1] += sole + 0.86 - AT["pelvis"][1]
    at = {name: joints[:, i] for i, name in enumerate(HUMANML3D.names)}
    for number, side in enumerate(("left", "right")):
        hip, knee, ankle, foot = (at[f"{side}_{part}"] for part in ("hip", "knee", "ankle", "foot"))
        phase = times + number / 2
        share = np.clip((phase % 1 - 0.5) / 0.5, 0, 1)
        swing = share * share * (3 - 2 * share)
        ankle[:, 2] = speed * (np.floor(phase) - number / 2 + 0.25 + swing)
        ankle[:, 0] = hip[:, 0]
        toe = AT[f"{side}_foot"] - AT[f"{side}_ankle"]
        ankle[:, 1] = sole - toe[1] + 0.08 * np.sin(np.pi * share) ** 2
        out = toes if side == "left" else -toes
        foot[:] = ankle + np.array([toe[2] * math.sin(out), toe[1], toe[2] * math.cos(out)])
        way = ankle - hip
        far = np.linalg.norm(way, axis=1, keepdims=True)
        thigh, shin = (float(np.linalg.norm(AT[b] - AT[a])) for a, b in
                       ((f"{side}_hip", f"{side}_knee"), (f"{side}_knee", f"{side}_ankle")))  # fmt: skip
        along = (thigh**2 - shin**2 + far**2) / (2 * far)
        ahead = np.cross(np.array([1.0, 0.0, 0.0]), -way / far)
        knee[:] = hip + along * way / far + np.sqrt(np.maximum(thigh**2 - along**2, 0)) * ahead
        shoulder, elbow, wrist = (at[f"{side}_{part}"] for part in ("shoulder", "elbow", "wrist"))
        sway = 0.3 * np.sin(2 * np.pi * phase)
        arm = np.stack([0 * times, -np.cos(sway), np.sin(sway)], axis=1)
        forearm = arm + np.array([0.0, 0.0, 0.5])
        elbow[:] = shoulder + 0.26 * arm
        wrist[:] = elbow + 0.265 * forearm / np.linalg.norm(forearm, axis=1, keepdims=True)
    return Motion(torch.from_numpy(joints), fps=fps)
