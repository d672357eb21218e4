"""What all formats have in common: endings, settings that are heeded or refused, several motions, whole files."""

from __future__ import annotations

import importlib
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch

import scenectl as sc
from scenectl.export.animation import Animation
from scenectl.export.export import FORMATS, Format, endings_of, export, export_beside
from scenectl.export.settings import Settings
from scenes.errors import UserError
from scenes.motion.motion import Motion
from scenes.world.scene import Scene
from tests.scenectl.export.moving import OWN, moving

OURS = ("bvh", "csv", "npz")


@pytest.fixture
def several(monkeypatch: pytest.MonkeyPatch) -> list[tuple[list[Animation], Path, Settings]]:
    """A format `.several` that holds all animations and heeds scenes and characters; what it was given to write."""
    given: list[tuple[list[Animation], Path, Settings]] = []
    module: Any = ModuleType("scenectl.export.several")
    module.SEVERAL, module.TAKES = True, frozenset({"scene", "character", "joints"})

    def write(animations: Sequence[Animation], path: Path, settings: Settings) -> None:
        given.append((list(animations), path, settings))

    module.write = write
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setitem(FORMATS, ".several", "several")
    return given


def batch() -> Motion:
    return Motion(torch.stack([moving(12, seed).joints for seed in range(3)]), skeleton=OWN, t0=1.5)


@pytest.mark.parametrize("name", OURS)
def test_modules_are_formats(name: str) -> None:
    module = importlib.import_module(f"scenectl.export.{name}")
    assert isinstance(module, Format) and FORMATS[f".{name}"] == name


@pytest.mark.parametrize("name", OURS)
def test_several_motions_come_into_files_of_their_own(name: str, tmp_path: Path) -> None:
    done = export(batch(), tmp_path / f"x.{name}")
    assert [file.name for file in done.files] == [f"x_{i}.{name}" for i in range(3)]
    assert done.moved == 0 and [animation.name for animation in done.animations] == ["x_0", "x_1", "x_2"]
    for i, file in enumerate(done.files):
        export(batch()[i], tmp_path / f"alone.{name}")
        if name == "npz":
            one, other = np.load(file), np.load(tmp_path / "alone.npz")
            assert all(np.array_equal(one[key], other[key]) for key in one)
        else:
            assert file.read_bytes() == (tmp_path / f"alone.{name}").read_bytes()


def test_several_motions_come_into_one_file_where_it_holds_them(several: list[Any], tmp_path: Path) -> None:
    done = sc.export(batch(), tmp_path / "x.several", fps=40, root_motion=False)
    ((animations, path, settings),) = several
    assert done.files == (path,) == (tmp_path / "x.several",)
    assert [animation.name for animation in animations] == ["x_0", "x_1", "x_2"]
    assert all(
        animation.fps == 40 and np.ptp(animation.roots[:, [0, 2]], axis=0).max() == 0 for animation in animations
    )
    assert settings.t0 == 1.5  # what the scene's clock shows at the first frame
    export(batch()[1], tmp_path / "one.several", Settings(scene=Scene.empty(0.0)))
    assert several[1][0][0].name == "one" and several[1][2].scene is not None


@pytest.mark.parametrize(("name", "told"), [("x.bvh", True), ("x.glb", True), ("x.usd", True), ("x.csv", False)])
def test_what_is_too_far_for_tools_is_doubted(name: str, told: bool, tmp_path: Path) -> None:
    near = moving(12)
    far = replace(near, joints=near.joints.double() + torch.tensor([0.0, 0.0, -4.65e6]))
    assert not export(near, tmp_path / name).doubts
    said = export(far, tmp_path / name).doubts
    assert bool(said) == told and (not told or "to 0.5 m only" in said[0])


def test_how_far_bones_moved_is_told(tmp_path: Path) -> None:
    motion = moving(12)
    joints = motion.joints.clone()
    joints[::2, 15] += 0.02
    done = export(replace(motion, joints=joints), tmp_path / "x.csv")
    assert 0.005 < done.moved < 0.03


@pytest.mark.parametrize(
    ("name", "stated", "sentence"),
    [
        ("x", {}, r"x' has no ending that tells its format; \.bvh, "),
        ("x.fbx", {}, r"ends with '\.fbx'; \.bvh, \.glb, "),
        ("x.bvh", {"layout": "bodies"}, r"\.bvh files take no layout; leave --layout out"),
        ("x.csv", {"scene": Scene.empty(0.0)}, r"\.csv files take no scene; leave --scene out"),
        ("x.npz", {"character": Path("hero.glb")}, r"\.npz files take no character; leave --character out"),
        ("x.several", {"unit": "cm"}, r"\.several files take no unit"),
        ("x.several", {"up": "z"}, r"\.several files take no up"),
        ("x.several", {"joints": {"left_knee": "Knee"}}, "state --character, too"),
        ("x.several", {"character": Path("hero.glb"), "names": "unity"}, "keep its own names; leave --names out"),
        ("x.bvh", {"unit": "cms"}, "unknown unit 'cms'; did you mean 'cm'"),
        ("x.bvh", {"up": "x"}, "unknown up axis 'x'; known are y, z"),
        ("x.bvh", {"names": "mixmo"}, "did you mean 'mixamo'"),
        ("x.bvh", {"fps": -3.0}, "-3 frames a second cannot be written"),
        ("folder.bvh", {}, r"cannot write '.*folder\.bvh': it is a folder"),
        ("file/x.csv", {}, r"cannot write '.*x\.csv': "),
    ],
)
def test_what_cannot_be_is_one_sentence_and_nothing_is_written(
    name: str, stated: dict[str, Any], sentence: str, several: list[Any], tmp_path: Path
) -> None:
    (tmp_path / "folder.bvh").mkdir()
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match=sentence) as caught:
        export(moving(4), tmp_path / name, **stated)
    assert "\n" not in str(caught.value) and not several
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", "folder.bvh"]


def test_no_motion_at_all_is_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="there is no motion to export"):
        export(batch()[:0], tmp_path / "x.bvh")


@pytest.mark.parametrize("name", OURS)
def test_a_file_is_whole_or_as_it_was(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / f"x.{name}"
    path.write_bytes(b"the old one")

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(UserError, match="No space left on device"):
        export(moving(4), path)
    assert path.read_bytes() == b"the old one" and list(tmp_path.iterdir()) == [path]


def test_files_beside_a_result(several: list[Any], tmp_path: Path) -> None:
    done = export_beside(batch(), tmp_path, endings_of("several, .bvh,CSV,bvh"))
    assert [file.name for one in done for file in one.files] == ["motion.several", "motion.bvh", "motion.csv"]
    assert [len(one.animations) for one in done] == [3, 1, 1]
    for text, sentence in (
        ("npz", "motion.npz is the result itself"),
        ("bvh,", "has no ending"),
        ("fbx", "ends with '.fbx'"),
    ):
        with pytest.raises(UserError, match=sentence):
            endings_of(text)


@pytest.mark.parametrize("before", ["", "import scenectl.export.names as names", "import scenectl.export.export"])
def test_sc_export_can_be_called_and_its_modules_imported_in_any_order(before: str, tmp_path: Path) -> None:
    code = f"""
import scenectl as sc
{before}
import torch
from scenes.motion.bones import rest_pose
motion = sc.Motion(rest_pose(sc.Motion.__dataclass_fields__["skeleton"].default).float().expand(3, 22, 3))
print(sc.export(motion, {str(tmp_path / "x.csv")!r}).files[0].name)
import scenectl.export.bvh as bvh
print(bvh.ORDER, sc.export.bvh.ORDER, "export" in dir(sc))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["x.csv", "ZXY", "ZXY", "True"], done.stderr
