"""BVH: any names, channel order, unit, axis and rate; written files come back; bad files get one sentence."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from scenectl.bench.studies.rotations import animated
from scenectl.data.formats.bvh import BvhFile, convert_bvh, load_bvh, read_bvh
from scenectl.data.formats.people import UNITS
from scenectl.data.joint_names import match_joints
from scenectl.export.export import export
from scenes.errors import UserError
from scenes.motion.bones import rest_pose
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid
from scenes.motion.skeleton import HUMANML3D, tree_order, with_lengths

# name -> (parent, offset in cm); sides are filled in for L and R
SPINES = {
    "mixamo": ["Spine", "Spine1", "Spine2"],
    "cmu": ["LowerBack", "Spine", "Spine1"],
    "daz": ["abdomen", "chest"],
    "biovision": ["Chest"],
    "bandai": ["Spine", "Chest"],
    "max": ["Spine", "Spine1", "Spine2", "Spine3"],
    "smpl": ["spine1", "spine2", "spine3"],
}
STYLES = {
    "mixamo": ("mixamorig:{}", "Hips", "Neck", "Head", "{Side}UpLeg {Side}Leg {Side}Foot {Side}ToeBase",
               "{Side}Shoulder {Side}Arm {Side}ForeArm {Side}Hand"),
    "cmu": ("{}", "Hips", "Neck", "Head", "{Side}UpLeg {Side}Leg {Side}Foot {Side}ToeBase",
            "{Side}Shoulder {Side}Arm {Side}ForeArm {Side}Hand"),
    "daz": ("{}", "hip", "neck", "head", "{s}Thigh {s}Shin {s}Foot {s}Toe", "{s}Collar {s}Shldr {s}ForeArm {s}Hand"),
    "biovision": ("{}", "Hips", "Neck", "Head", "{Side}Hip {Side}Knee {Side}Ankle -",
                  "{Side}Collar {Side}Shoulder {Side}Elbow {Side}Wrist"),
    "bandai": ("{}", "Hips", "Neck", "Head", "UpperLeg_{S} LowerLeg_{S} Foot_{S} Toes_{S}",
               "Shoulder_{S} UpperArm_{S} LowerArm_{S} Hand_{S}"),
    "max": ("Bip01 {}", "Pelvis", "Neck", "Head", "{S} Thigh|{S} Calf|{S} Foot|{S} Toe0",
            "{S} Clavicle|{S} UpperArm|{S} Forearm|{S} Hand"),
    "smpl": ("{}", "pelvis", "neck", "head", "{side}_hip {side}_knee {side}_ankle {side}_foot",
             "{side}_collar {side}_shoulder {side}_elbow {side}_wrist"),
}  # fmt: skip
LEG = [(10, -5, 0), (0, -40, 0), (0, -42, 0), (0, -5, 14)]
ARM = [(5, 14, 0), (13, 0, 0), (27, 0, 0), (26, 0, 0)]


def skeleton(style: str) -> dict[str, tuple[str, tuple[float, float, float]]]:
    wrap, pelvis, neck, head, leg, arm = STYLES[style]
    tree: dict[str, tuple[str, tuple[float, float, float]]] = {wrap.format(pelvis): ("", (0, 0, 0))}
    last = wrap.format(pelvis)
    for i, name in enumerate(SPINES[style]):
        tree[wrap.format(name)] = (last, (0, 0, 0) if style == "cmu" and i == 0 else (0, 12, 1))
        last = wrap.format(name)
    tree[wrap.format(neck)] = (last, (0, 20, 0))
    tree[wrap.format(head)] = (wrap.format(neck), (0, 9, 3))
    for side, sign in (("left", 1), ("right", -1)):
        for chain, offsets, start in ((leg, LEG, wrap.format(pelvis)), (arm, ARM, last)):
            above = start
            for name, (x, y, z) in zip(chain.split("|" if "|" in chain else " "), offsets, strict=True):
                if name == "-":
                    continue
                words = {"side": side, "Side": side.title(), "s": side[0], "S": side[0].upper()}
                full = wrap.format(name.format(**words))
                tree[full] = (above, (sign * x, y, z))
                above = full
    return tree


def write(
    path: Path, tree: dict[str, tuple[str, tuple[float, float, float]]], frames: int = 4, rate: float = 20.0,
    order: str = "zxy", scale: float = 1.0, seed: int = 0, still: bool = False,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Write a file with random rotations, and return every joint's positions worked out with scipy."""
    rng = np.random.default_rng(seed)
    places: dict[str, np.ndarray] = {}
    turns: dict[str, Rotation] = {}
    columns: list[np.ndarray] = []
    lines = ["HIERARCHY"]

    def visit(name: str, depth: int) -> None:
        parent, offset = tree[name]
        own = np.array(offset) * scale
        angles = rng.uniform(-25, 25, (frames, 3)) * (0 if still else 1)
        local = Rotation.from_euler(order.upper(), angles, degrees=True)
        if parent:
            places[name] = places[parent] + turns[parent].apply(own)
            turns[name] = turns[parent] * local
            channels, moved = "3", []
        else:
            steps = np.linspace(0, 1, frames)[:, None] * np.array([30.0, 0.0, 80.0]) + np.array([0, 95.0, 0])
            places[name], turns[name] = steps * scale, local
            channels, moved = "6 Xposition Yposition Zposition", [steps * scale]
        columns.extend([*moved, angles])
        listed = " ".join(f"{axis.upper()}rotation" for axis in order)
        vector = " ".join(f"{v:.8f}" for v in own)
        lines.append(f"{'JOINT' if parent else 'ROOT'} {name}\n{{\nOFFSET\t{vector}\nCHANNELS {channels} {listed}")
        children = [child for child, (above, _) in tree.items() if above == name]
        for child in children:
            visit(child, depth + 1)
        if not children:
            lines.append("End Site {\nOFFSET 0 0 " + f"{9 * scale:.8f}" + "\n}")
        lines.append("}")

    visit(next(iter(tree)), 0)
    rows = np.concatenate(columns, axis=1)
    body = "\n".join(" ".join(f"{v:.9f}" for v in row) for row in rows)
    text = "\n".join(lines) + f"\nMOTION\nFrames: {frames}\nFrame Time: {1 / rate:.9f}\n{body}\n"
    path.write_text(text.replace("\n", "\r\n" if seed % 2 else "\n"))
    return places


@pytest.mark.parametrize("style", sorted(STYLES))
def test_common_skeletons_are_mapped(style: str, tmp_path: Path) -> None:
    tree = skeleton(style)
    places = write(tmp_path / "a.bvh", tree)
    file = read_bvh(tmp_path / "a.bvh")
    clip = convert_bvh(file)
    assert clip.unit == "cm" and clip.motion.frames == 4 and clip.motion.fps == 20
    names = list(tree)
    wrap, pelvis, neck, head, leg, arm = STYLES[style]
    expected = {"pelvis": pelvis, "neck": neck, "head": head}
    for side in ("left", "right"):
        words = {"side": side, "Side": side.title(), "s": side[0], "S": side[0].upper()}
        for ours, theirs in (("hip knee ankle foot", leg), ("collar shoulder elbow wrist", arm)):
            for our, their in zip(ours.split(), theirs.split("|" if "|" in theirs else " "), strict=True):
                if their != "-":
                    expected[f"{side}_{our}"] = their.format(**words)
    for joint, name in expected.items():
        full = wrap.format(name)
        assert full in names and clip.joints[joint] == full
        assert np.allclose(clip.motion.joint(joint).numpy(), places[full] / 100, atol=1e-5), joint
    assert torch.isfinite(clip.motion.joints).all()


@pytest.mark.parametrize("order", ["".join(order) for order in permutations("xyz")])
def test_any_channel_order(order: str, tmp_path: Path) -> None:
    tree = skeleton("mixamo")
    places = write(tmp_path / "a.bvh", tree, order=order, seed=3)
    motion = load_bvh(tmp_path / "a.bvh")
    assert np.allclose(motion.joint("left_wrist").numpy(), places["mixamorig:LeftHand"] / 100, atol=1e-5)


@pytest.mark.parametrize("unit", sorted(UNITS))
def test_units_are_guessed_from_the_legs_or_stated(unit: str, tmp_path: Path) -> None:
    tree = skeleton("bandai")
    places = write(tmp_path / "a.bvh", tree, scale=0.01 / UNITS[unit])
    for stated in (None, unit):
        clip = convert_bvh(read_bvh(tmp_path / "a.bvh"), unit=stated, source="a.bvh")
        assert clip.unit == unit and unit in clip.message and ("stated" if stated else "guessed") in clip.message
        assert np.allclose(clip.motion.joint("head").numpy(), places["Head"] * UNITS[unit], atol=1e-5)


@pytest.mark.filterwarnings("ignore:Gimbal lock")
@pytest.mark.parametrize(("up", "turn"), [("z", ("x", 90)), ("x", ("z", -90))])
def test_stated_up_axis(up: str, turn: tuple[str, float], tmp_path: Path) -> None:
    # the same motion, written by a tool whose up axis is another: its root offset and rotations are turned
    write(tmp_path / "y.bvh", skeleton("mixamo"), still=True)
    text = (tmp_path / "y.bvh").read_text().split("Frame Time")
    into = Rotation.from_euler(*turn, degrees=True)
    rows = [np.array(line.split(), float) for line in text[1].splitlines()[1:]]
    for row in rows:
        row[:3] = into.apply(row[:3])
        row[3:6] = (into * Rotation.from_euler("ZXY", row[3:6], degrees=True)).as_euler("ZXY", degrees=True)
    body = "\n".join(" ".join(f"{v:.9f}" for v in row) for row in rows)
    (tmp_path / "up.bvh").write_text(f"{text[0]}Frame Time: 0.05\n{body}\n")
    expected, other = load_bvh(tmp_path / "y.bvh"), load_bvh(tmp_path / "up.bvh", up=up)
    assert torch.allclose(expected.joints, other.joints, atol=1e-5)
    wrong = convert_bvh(read_bvh(tmp_path / "up.bvh"))
    assert f"but along {up}; state --up {up}" in wrong.doubts[0]
    assert not convert_bvh(read_bvh(tmp_path / "up.bvh"), up=up).doubts


def test_multiples_of_the_rate_are_strided_and_others_interpolated(tmp_path: Path) -> None:
    tree = skeleton("mixamo")
    places = write(tmp_path / "120.bvh", tree, frames=61, rate=119.88)
    clip = convert_bvh(read_bvh(tmp_path / "120.bvh"))
    assert clip.motion.frames == 11 and "every 6. frame kept" in clip.message
    assert np.allclose(clip.motion.joint("head").numpy(), places["mixamorig:Head"][::6] / 100, atol=1e-5)
    places = write(tmp_path / "30.bvh", tree, frames=31, rate=30)
    clip = convert_bvh(read_bvh(tmp_path / "30.bvh"))
    assert clip.motion.frames == 21 and "interpolated" in clip.message
    head = places["mixamorig:Head"] / 100
    assert np.allclose(clip.motion.joint("head")[::2].numpy(), head[::3], atol=1e-5)
    neck = places["mixamorig:Neck"] / 100  # between frames bones point halfway, and are as long as they are
    bone, size = (head - neck)[1:3].mean(axis=0), np.linalg.norm((head - neck)[0])
    halfway = clip.motion.joint("head")[1] - clip.motion.joint("neck")[1]
    assert np.allclose(halfway.numpy(), bone / np.linalg.norm(bone) * size, atol=1e-5)
    # a straight path at constant speed stays one: 30 cm and 80 cm in a second
    speed = clip.motion.joint("pelvis").diff(dim=0) * 20
    assert torch.allclose(speed, torch.tensor([0.3, 0.0, 0.8]).expand(20, 3), atol=1e-4)


@pytest.mark.parametrize("style", ["mixamo", "biovision", "max"])
def test_spine_has_our_proportions_whatever_the_file_has(style: str, tmp_path: Path) -> None:
    write(tmp_path / "a.bvh", skeleton(style), still=True)
    motion = load_bvh(tmp_path / "a.bvh")
    spine = motion.select(["pelvis", "spine1", "spine2", "spine3", "neck"])[0]
    steps = spine.diff(dim=0).norm(dim=-1)
    ours = torch.tensor([HUMANML3D.bone_lengths[HUMANML3D.index(j)] for j in ("spine1", "spine2", "spine3", "neck")])
    assert torch.allclose(steps / steps.sum(), (ours / ours.sum()).float(), atol=2e-2)  # files bend a little
    assert (spine.diff(dim=0)[:, 1] > 0).all()


def test_collars_in_one_point_are_placed_apart(tmp_path: Path) -> None:
    tree = skeleton("cmu")
    for side in ("Left", "Right"):
        tree[f"{side}Shoulder"] = ("Spine1", (0, 0, 0))
    write(tmp_path / "a.bvh", tree)
    motion = load_bvh(tmp_path / "a.bvh")
    middle = (motion.joint("neck") + motion.joint("left_shoulder")) / 2
    assert torch.allclose(motion.joint("left_collar"), middle)


def test_missing_feet_are_end_sites(tmp_path: Path) -> None:
    write(tmp_path / "a.bvh", skeleton("biovision"), still=True)
    motion = load_bvh(tmp_path / "a.bvh")
    step = motion.joint("left_foot") - motion.joint("left_ankle")
    assert torch.allclose(step, torch.tensor([0.0, 0.0, 0.09]).expand_as(step), atol=1e-5)


def test_position_channels_replace_the_offset(tmp_path: Path) -> None:
    write(tmp_path / "a.bvh", skeleton("mixamo"))
    text = (tmp_path / "a.bvh").read_text()
    moved = text.replace("OFFSET\t0.00000000 0.00000000 0.00000000", "OFFSET\t7.0 95.0 -3.0", 1)
    (tmp_path / "b.bvh").write_text(moved)
    assert moved != text
    assert torch.allclose(load_bvh(tmp_path / "a.bvh").joints, load_bvh(tmp_path / "b.bvh").joints)


def test_names_that_say_too_little_can_be_stated(tmp_path: Path) -> None:
    tree = {k.replace("LeftLeg", "Foo"): (v[0].replace("LeftLeg", "Foo"), v[1]) for k, v in skeleton("cmu").items()}
    write(tmp_path / "a.bvh", tree)
    with pytest.raises(UserError, match=r"a\.bvh': no joint found for left_knee among Hips"):
        load_bvh(tmp_path / "a.bvh")
    assert load_bvh(tmp_path / "a.bvh", joints={"left_knee": "Foo"}).frames == 4
    with pytest.raises(UserError, match="did you mean 'Foo'"):
        load_bvh(tmp_path / "a.bvh", joints={"left_knee": "Fo"})
    with pytest.raises(UserError, match="did you mean 'left_knee'"):
        load_bvh(tmp_path / "a.bvh", joints={"left_kne": "Foo"})


def test_every_missing_joint_is_named() -> None:
    with pytest.raises(UserError) as caught:
        match_joints(["Hips", "Spine", "Neck", "LeftUpLeg", "LeftLeg", "LeftFoot"])
    for joint in ("head", "right_hip", "left_wrist"):
        assert joint in str(caught.value)
    assert "left_knee" not in str(caught.value) and "spine2" not in str(caught.value)


def real_clip(shared: Path, clip: int) -> torch.Tensor:
    with np.load(shared / "data" / "motions" / "motions_20fps.npz") as data:
        start, frames = int(data["length"][:clip].sum()), int(data["length"][clip])
        steps = data["delta"][:, :, start : start + frames].transpose(2, 0, 1).astype(np.int64)
        joints = torch.from_numpy(steps.cumsum(0) * float(data["quant"])).float()
    joints[:, 1:] += joints[:, :1]
    return joints


@pytest.mark.parametrize("fps", [20.0, 30.0, 60.0])
@pytest.mark.parametrize("unit", ["m", "cm"])
def test_what_is_written_is_read_back(unit: str, fps: float, tmp_path: Path) -> None:
    skeleton = with_lengths(HUMANML3D, np.linspace(0.9, 1.1, 22) * HUMANML3D.bone_lengths)
    motion = rigid(replace(animated(50, seed=int(fps))[1], fps=fps), skeleton)
    assert export(motion, tmp_path / "out.bvh", unit=unit).moved == 0
    file = read_bvh(tmp_path / "out.bvh")
    assert [name for name in file.names if not name.endswith(".end")] == [
        HUMANML3D.names[joint] for joint in tree_order(HUMANML3D.parents)
    ]
    clip = convert_bvh(file, fps=fps)
    assert clip.unit == unit and set(clip.joints) == set(HUMANML3D.names)
    assert (clip.motion.joints - motion.joints).abs().max() < 1e-4
    still = convert_bvh(replace(file, values=np.zeros_like(file.values)), fps=fps).motion  # its T-pose
    torch.testing.assert_close(still.joints[0].double(), rest_pose(skeleton), atol=1e-4, rtol=0)


def test_real_motion_is_fitted_and_survives_writing(tmp_path: Path, shared: Path) -> None:
    for number in (3, 400, 700):
        joints = real_clip(shared, number)
        moved = export(Motion(joints), tmp_path / "out.bvh").moved
        away = (load_bvh(tmp_path / "out.bvh").joints - joints).norm(dim=-1)
        assert float(away.max()) == pytest.approx(moved, abs=1e-4)
        assert 0 < moved < 0.03 and away.mean() < 0.01  # captured spines bend within pelvis and chest by millimetres


def test_files_of_older_versions_are_read(tmp_path: Path) -> None:
    """They had a joint of length zero, ``<parent>_to_<child>``, for each bone that leaves a joint which branches."""
    motion = animated(30, seed=5)[1]
    export(motion, tmp_path / "new.bvh")
    new = read_bvh(tmp_path / "new.bvh")
    names, parents, offsets, channels, columns = [], [], [], [], []
    at, taken = {-1: -1}, 0
    for joint, (name, parent, own) in enumerate(zip(new.names, new.parents, new.channels, strict=True)):
        values, taken = new.values[:, taken : taken + len(own)], taken + len(own)
        above = at[parent]
        if new.parents.count(parent) > 1 and own:
            names.append(f"{new.names[parent]}_to_{name}")
            parents.append(above)
            offsets.append(np.zeros(3))
            channels.append(own)
            columns.append(np.zeros((len(values), len(own))))
            above = len(names) - 1
        at[joint] = len(names)
        for some, one in ((names, name), (parents, above), (offsets, new.offsets[joint]), (channels, own)):
            some.append(one)
        columns.append(values)
    values = np.concatenate(columns, axis=1)
    old = BvhFile(tuple(names), tuple(parents), np.array(offsets), tuple(channels), values, new.frame_time)
    assert len(old.names) == len(new.names) + 6
    assert (convert_bvh(old).motion.joints - motion.joints).abs().max() < 1e-4


def test_written_angles_do_not_jump(tmp_path: Path, shared: Path) -> None:
    export(Motion(real_clip(shared, 400)), tmp_path / "out.bvh")
    values = read_bvh(tmp_path / "out.bvh").values
    assert np.abs(np.diff(values[:, 3:6], axis=0)).max() < 30  # degrees a frame, of the root


def test_padding_is_not_written(tmp_path: Path, shared: Path) -> None:
    joints = torch.from_numpy(np.load(shared / "data" / "humanml3d" / "012314_new_joints.npy"))
    valid = torch.arange(len(joints)) < 50
    export(Motion(joints, valid), tmp_path / "out.bvh")
    assert load_bvh(tmp_path / "out.bvh").frames == 50
    with pytest.raises(UserError, match="valid frame"):
        export(Motion(joints, torch.zeros_like(valid)), tmp_path / "out.bvh")
    export(Motion(joints[None], valid[None]), tmp_path / "one.bvh")
    assert (tmp_path / "one.bvh").read_bytes() == (tmp_path / "out.bvh").read_bytes()


BREAKS = {
    "is not BVH": lambda t: "hello",
    "lacks the sections": lambda t: t.split("MOTION")[0],
    "more than one skeleton": lambda t: t.replace("MOTION", "ROOT B\n{\nOFFSET 0 0 0\n}\nMOTION"),
    "is it cut short": lambda t: t[: int(len(t) * 0.98)].rsplit(" ", 3)[0],
    "hierarchy is cut short": lambda t: t.replace("}\nMOTION", "MOTION"),
    "braces do not match": lambda t: t.replace("\nMOTION", "\n}\nMOTION"),
    "not a number": lambda t: t.rstrip() + "x\n",
    "not finite": lambda t: t.rstrip().rsplit(" ", 1)[0] + " nan\n",
    "must be positive": lambda t: t.replace("Frame Time: 0.05", "Frame Time: -0.05"),
    "'Frame Time:' is not 1 finite": lambda t: t.replace("Frame Time: 0.05", "Frame Time: fast "),
    "does not begin with": lambda t: t.replace("Frame Time", "FrameTime"),
    "holds no frames": lambda t: t.split("Frames:")[0] + "Frames: 0\nFrame Time: 0.05\n",
    "unknown channel 'wrotation'": lambda t: t.replace("Zrotation", "Wrotation", 1),
    "lists 3": lambda t: t.replace("CHANNELS 3", "CHANNELS 4", 1),
    "is not 3 finite": lambda t: t.replace("OFFSET\t0.00000000 ", "OFFSET\t", 1),
    "1e-05 frames a second": lambda t: t.replace("Frame Time: 0.05", "Frame Time: 100000."),
    "'Frame Time:' is not 1 finite number": lambda t: t.replace("Frame Time: 0.050000000", "Frame Time: 1e300"),
    "1e\\+11 frames a second": lambda t: t.replace("Frame Time: 0.050000000", "Frame Time: 1e-11"),
    "lacks the sections HIERARCHY and MOTION": lambda t: t.replace("\r", "").replace("\n", " "),
    "does not begin with 'Frames:'": lambda t: t.replace("\nFrame Time", " Frame Time"),
    "unknown channel": lambda t: t.replace("rotation\n", "rotation "),
    "'{' is not understood": lambda t: t.replace("HIERARCHY", "HIERARCHY {"),
    "does not begin with a ROOT": lambda t: "HIERARCHY\nEnd Site\n{\n}\nMOTION" + t.split("MOTION")[1],
    "or over 1e\\+12": lambda t: t.rstrip().rsplit(" ", 1)[0] + " 1e13\n",
    "over 1000 joints": lambda t: t.replace("ROOT", "ROOT r\n{\n" + "JOINT a\n{\n" * 1001 + "ROOT", 1),
    "is not understood": lambda t: t.replace("CHANNELS", "CANALS", 1),
}


@pytest.mark.parametrize("reason", BREAKS)
def test_broken_files_get_one_sentence(reason: str, tmp_path: Path) -> None:
    write(tmp_path / "a.bvh", skeleton("mixamo"))
    (tmp_path / "bad.bvh").write_text(BREAKS[reason]((tmp_path / "a.bvh").read_text()))
    with pytest.raises(UserError, match=reason) as caught:
        load_bvh(tmp_path / "bad.bvh")
    assert "bad.bvh" in str(caught.value) and "\n" not in str(caught.value)


def test_wrong_arguments_get_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="does not exist"):
        load_bvh(tmp_path / "none.bvh")
    write(tmp_path / "a.bvh", skeleton("mixamo"))
    with pytest.raises(UserError, match="did you mean 'cm'"):
        load_bvh(tmp_path / "a.bvh", unit="cms")
    with pytest.raises(UserError, match="unknown up axis 'w'"):
        load_bvh(tmp_path / "a.bvh", up="w")
    with pytest.raises(UserError, match="legs would be 82 m long"):
        load_bvh(tmp_path / "a.bvh", unit="m")
    with pytest.raises(UserError, match="state a positive number"):
        load_bvh(tmp_path / "a.bvh", fps=0.0)
    write(tmp_path / "tiny.bvh", skeleton("mixamo"), scale=1e-6)
    with pytest.raises(UserError, match="fit no known unit"):
        load_bvh(tmp_path / "tiny.bvh")
    write(tmp_path / "short.bvh", skeleton("mixamo"), frames=3, rate=120)
    with pytest.raises(UserError, match="too few"):
        load_bvh(tmp_path / "short.bvh")


def test_a_file_of_blank_lines_is_read_at_once(tmp_path: Path) -> None:
    (tmp_path / "blank.bvh").write_text("HIERARCHY" + "\n" * 300_000)
    with pytest.raises(UserError, match="lacks the sections"):
        read_bvh(tmp_path / "blank.bvh")
