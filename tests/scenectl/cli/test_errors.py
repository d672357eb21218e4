"""Bad input of every class gets one sentence, exit status 2 and no traceback, and existing files survive."""

from __future__ import annotations

import os
import pickle
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from scenes.motion.motion import Motion

HEAD = 'prompt = "a person walks"\nseconds = 4.0\n'
OBJECT = '[[scene.objects]]\nprimitive = { shape = "sphere", center = [0, 1, 0], radius = 0.2 }\n'
BOX = '[[scene.primitives]]\nshape = "box"\ncenter = [0.0, 1.0, 2.0]\nsize = [1.0, 2.0, 1.0]\n'

TASKS: dict[str, tuple[str, str]] = {
    "unknown joint": (
        '[[goal]]\nuse = "joint_target"\njoint = "right_wirst"\nposition = [0, 1, 1]\nat = 1.0', "right_wrist"),
    "unknown goal": ('[[goal]]\nuse = "joint_tagret"', "joint_target"),
    "unknown goal parameter": ('[[goal]]\nuse = "joint_target"\npositoin = [0, 1, 1]', "position"),
    "missing goal parameter": ('[[goal]]\nuse = "head_height"', "height"),
    "goal without use": ('[[goal]]\njoint = "head"', "use"),
    "goal that is no table": ("goal = [1, 2]", "[[goal]]"),
    "unknown key": ('prompts = "x"', "prompt"),
    "unknown key in a table": ("[walk]\nto = [0.0, 1.0]\nradios = 0.3", "radius"),
    "unknown key of the solver": ("[solver]\niteration = 3", "iterations"),
    "unknown scene": ('scene = "livingroom"', "living_room"),
    "missing scene file": ('scene = "kitchen.glb"', "kitchen.glb"),
    "unknown primitive": ('[[scene.primitives]]\nshape = "boks"', "box"),
    "primitive without a shape": ("[[scene.primitives]]\ncenter = [0, 1, 1]", "shape"),
    "primitive of no size": ('[[scene.primitives]]\nshape = "sphere"\ncenter = [0, 1, 2]\nradius = -1.0', "radius"),
    "object without a shape": ("[[scene.objects]]\ntimes = [0]\npositions = [[0, 0, 3]]", "'mesh' or 'primitive'"),
    "object without times": (OBJECT + "positions = [[0, 0, 3]]", "'times' is missing in [scene.objects 1]"),
    "object with an unknown key": (OBJECT + "times = [0]\npositions = [[0, 0, 3]]\nheading = [0]", "headings"),
    "object whose times are words": (OBJECT + 'times = ["x"]\npositions = [[0, 0, 3]]', "scene.objects 1.times"),
    "object with a position of two": (OBJECT + "times = [0]\npositions = [[0, 3]]", "a number is missing"),
    "object with too few headings": (
        OBJECT + "times = [0, 1]\npositions = [[0, 0, 3], [0, 0, 4]]\nheadings = [0]", "scene: object 1: trajectory"),
    "object back in time": (OBJECT + "times = [1, 0]\npositions = [[0, 0, 3], [0, 0, 4]]", "later than the one before"),
    "primitive object in inches": (OBJECT + 'unit = "in"\ntimes = [0]\npositions = [[0, 0, 3]]', "'unit' is for mesh"),
    "object of a missing file": (
        '[[scene.objects]]\nmesh = "cat.glb"\ntimes = [0]\npositions = [[0, 0, 3]]', "cat.glb"),
    "start inside an object": (
        "start = [0.0, 0.0]\n" + OBJECT + "times = [0]\npositions = [[0, 0, 0]]", "inside or against"),
    "goal outside the scene": (
        BOX + '[[goal]]\nuse = "joint_target"\nposition = [90.0, 1.0, 0.0]\nat = 1.0', "outside the scene"),
    "walk to outside the scene": (BOX + "[walk]\nto = [90.0, 0.0]", "not free"),
    "walk too far": ("[walk]\nto = [0.0, 15.0]", "too far"),
    "walk into an obstacle": (BOX + "[walk]\nto = [0.0, 2.0]", "not free"),
    "time outside the motion": ('[[goal]]\nuse = "head_height"\nheight = 1.5\nat = 9.0', "9"),
    "window outside the motion": ('[[goal]]\nuse = "foot_contact"\nwindow = [5.0, 6.0]', "window"),
    "wrong type": ('[[goal]]\nuse = "head_height"\nheight = "tall"', "tall"),
    "negative weight": ('[[goal]]\nuse = "foot_contact"\nweight = -1.0', "weight"),
    "start inside an obstacle": ("start = { position = [0.0, 2.0] }\n" + BOX, "inside"),
    "start outside the scene": ("start = { position = [90.0, 2.0] }\n" + BOX, "outside"),
    "start in the air": ("start = { position = [0.0, 1.0, 0.0] }", "stand on"),
    "start of three words": ('start = "somewhere"', "sample"),
    "unknown generator": ('[generator]\nname = "mscott"', "mscot"),
    "missing weights": ('[generator]\nweights = "nowhere"', "nowhere"),
    "missing track": ('[[goal]]\nuse = "joint_target"\ntrack = { kind = "array", file = "t.npy" }', "t.npy"),
}  # fmt: skip

GENERATED = ("unknown generator", "missing weights")
"""What only a run finds out."""


def write(folder: Path, text: str, head: str = HEAD) -> Path:
    """A task file: plain keys come before the tables of `head`'s kind, so `text` goes last."""
    path = folder / "task.toml"
    path.write_text(head + text + "\n")
    return path


def one_sentence(said: object, *words: str) -> None:
    assert said.status == 2, said  # type: ignore[attr-defined]
    text = said.err.strip()  # type: ignore[attr-defined]
    assert "Traceback" not in text
    assert len(text.splitlines()) == 1, text
    assert text.startswith("scenectl: ")
    for word in words:
        assert word in text, text


@pytest.mark.parametrize("kind", TASKS)
def test_task_files(kind: str, tmp_path: Path, scenectl: Callable[..., object]) -> None:
    text, word = TASKS[kind]
    task = write(tmp_path, text)
    said = scenectl("run", task, "-o", tmp_path / "out") if kind in GENERATED else scenectl("check", task)
    one_sentence(said, word)
    assert not (tmp_path / "out" / "motion.npz").exists()


@pytest.mark.parametrize(
    ("head", "word"),
    [
        ("seconds = 4.0\n", "'prompt' is missing"),
        ('prompt = "x"\n', "'seconds' is missing"),
        ('prompt = "x"\nseconds = 60.5\n', "seconds"),
        ('prompt = ""\nseconds = 4.0\n', "prompt"),
        ('prompt = "x\n', "TOML"),
        ("prompt = 'x'\nseconds = 'long'\n", "seconds"),
    ],
)
def test_the_head_of_a_task(head: str, word: str, tmp_path: Path, scenectl: Callable[..., object]) -> None:
    one_sentence(scenectl("check", write(tmp_path, "", head)), word)


def test_task_files_that_are_none(tmp_path: Path, scenectl: Callable[..., object]) -> None:
    one_sentence(scenectl("check", tmp_path / "nope.toml"), "does not exist")
    one_sentence(scenectl("check", tmp_path), "is a folder")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    one_sentence(scenectl("check", tmp_path / "binary.toml"), "cannot be read")


def ply(path: Path, vertices: str, count: int = 4, faces: str = "3 0 1 2\n3 0 3 1\n3 0 2 3\n3 1 3 2\n") -> Path:
    lines = faces.count("\n")
    path.write_text(
        f"ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {lines}\nproperty list uchar int vertex_indices\nend_header\n{vertices}{faces}"
    )
    return path


@pytest.mark.parametrize(
    ("vertices", "faces", "word"),
    [
        ("0 0 0\n0 0 1\n0 1 0\n1 0 0\n", "", "no triangles"),
        ("0 0 0\n0 0 1\nnan 1 0\n1 0 0\n", None, "NaN"),
        ("0 0 0\n0 0 9000\n0 9000 0\n9000 0 0\n", None, "unit"),
        ("0 0 0\n0 0 0.001\n0 0.001 0\n0.001 0 0\n", None, "unit"),
    ],
    ids=["empty", "not a number", "kilometres", "millimetres"],
)
def test_meshes(vertices: str, faces: str | None, word: str, tmp_path: Path, scenectl: Callable[..., object]) -> None:
    path = ply(tmp_path / "mesh.ply", vertices) if faces is None else ply(tmp_path / "mesh.ply", vertices, faces=faces)
    one_sentence(scenectl("bake", path, "--resolution", 16), word)


def test_mesh_files(tmp_path: Path, scenectl: Callable[..., object]) -> None:
    one_sentence(scenectl("bake", tmp_path / "nope.ply"), "does not exist")
    one_sentence(scenectl("bake", "living_rom"), "living_room")
    (tmp_path / "mesh.step").write_text("x")
    one_sentence(scenectl("bake", tmp_path / "mesh.step"), "format")
    (tmp_path / "mesh.glb").write_bytes(b"not a mesh")
    one_sentence(scenectl("bake", tmp_path / "mesh.glb"), "cannot be read")
    cube = ply(tmp_path / "mesh.ply", "0 0 0\n0 0 1\n0 1 0\n1 0 0\n")
    one_sentence(scenectl("bake", cube, "--unit", "parsec"), "unit")
    one_sentence(scenectl("bake", cube, "--up", "w"), "up axis")
    one_sentence(scenectl("bake", cube, "--free-space", "inside"), "--free-space")
    one_sentence(scenectl("bake", cube, "--resolution", 3), "resolution")


class _Trap:
    """Unpickling this would create a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, ...]:
        return (Path.touch, (self.path,))


def test_pickles_are_never_opened(tmp_path: Path, scenectl: Callable[..., object]) -> None:
    sprung = tmp_path / "sprung"
    np.save(tmp_path / "track.npy", np.array([_Trap(sprung)], dtype=object), allow_pickle=True)
    task = write(tmp_path, '[[goal]]\nuse = "joint_target"\ntrack = { kind = "array", file = "track.npy" }')
    one_sentence(scenectl("check", task), "track.npy")
    (tmp_path / "motion.npz").write_bytes(pickle.dumps(_Trap(sprung)))
    one_sentence(scenectl("score", tmp_path / "motion.npz", write(tmp_path, "")), "motion.npz")
    assert not sprung.exists()


def test_motion_files(tmp_path: Path, tiny: object, scenectl: Callable[..., object]) -> None:
    task = write(tmp_path, "")
    one_sentence(scenectl("score", tmp_path / "nope.npz", task), "does not exist")
    good = tmp_path / "good.npz"
    Motion(tiny.statue().expand(80, 22, 3).clone()).save(good)  # type: ignore[attr-defined]
    assert scenectl("score", good, task, "--allow-unmet").status == 0
    late = write(tmp_path, '[[goal]]\nuse = "head_height"\nheight = 1.5\nat = 3.9')
    Motion(tiny.statue().expand(40, 22, 3).clone()).save(tmp_path / "short.npz")  # type: ignore[attr-defined]
    one_sentence(scenectl("score", tmp_path / "short.npz", late), "3.9 s")
    task = write(tmp_path, "")
    (tmp_path / "cut.npz").write_bytes(good.read_bytes()[:900])
    one_sentence(scenectl("score", tmp_path / "cut.npz", task), "cut.npz")
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    one_sentence(scenectl("score", tmp_path / "other.npz", task), "other.npz")
    joints = tiny.statue().expand(80, 22, 3).clone()  # type: ignore[attr-defined]
    joints[3] = float("nan")
    Motion(joints).save(tmp_path / "nan.npz")
    one_sentence(scenectl("score", tmp_path / "nan.npz", task), "not finite")
    parts = dict(np.load(good))
    np.savez(tmp_path / "still.npz", **{**parts, "fps": np.float64(0)})
    one_sentence(scenectl("score", tmp_path / "still.npz", task), "frames a second")
    np.savez(tmp_path / "none.npz", **{**parts, "joints": parts["joints"][:0], "valid": parts["valid"][:0]})
    one_sentence(scenectl("score", tmp_path / "none.npz", task), "no frames")


def test_seeds_and_counts(tmp_path: Path, tiny_generator: None, scenectl: Callable[..., object]) -> None:
    task, out = write(tmp_path, ""), tmp_path / "out"
    for seed in (-1, 2**70):
        one_sentence(scenectl("run", task, "-o", out, "--seed", seed), "seed")
    one_sentence(scenectl("run", task, "-o", out, "--samples", 999999999), "samples")
    one_sentence(scenectl("check", write(tmp_path, "", HEAD + "seed = -1\n")), "seed")


def test_reports_without_a_task(tmp_path: Path, tiny: object, scenectl: Callable[..., object]) -> None:
    Motion(tiny.statue().expand(80, 22, 3).clone()).save(tmp_path / "motion.npz")  # type: ignore[attr-defined]
    for text in ('{"format": 1}', '{"format": 1, "task": 5}'):
        (tmp_path / "report.json").write_text(text)
        one_sentence(scenectl("view", tmp_path, "--png", tmp_path / "x.png"), "report.json")
    one_sentence(scenectl("view", tmp_path, "--at", "nan", "--png", tmp_path / "x.png"), "--at")


def test_weights(tmp_path: Path, scenectl: Callable[..., object]) -> None:
    task = write(tmp_path, "")
    weights = tmp_path / "weights"
    weights.mkdir()
    for name in (
        "tokenizer.safetensors",
        "transformer.safetensors",
        "refiner.safetensors",
        "config.toml",
        "config.json",
    ):
        (weights / name).write_bytes(b"\x00\x01 broken")
    one_sentence(scenectl("run", task, "-o", tmp_path / "out", "--weights", weights), "weights")


def test_output_folders(tmp_path: Path, tiny_generator: None, scenectl: Callable[..., object]) -> None:
    task = write(tmp_path, "")
    (tmp_path / "file").write_text("keep me")
    one_sentence(scenectl("run", task, "-o", tmp_path / "file"), "is a file")
    one_sentence(scenectl("run", task, "-o", tmp_path / "file" / "below"))
    assert (tmp_path / "file").read_text() == "keep me"
    one_sentence(scenectl("run", task, "-o", "/proc/nowhere"))


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_unwritable_folder(tmp_path: Path, tiny_generator: None, scenectl: Callable[..., object]) -> None:
    closed = tmp_path / "closed"
    closed.mkdir()
    closed.chmod(stat.S_IRUSR | stat.S_IXUSR)
    one_sentence(scenectl("run", write(tmp_path, ""), "-o", closed), "permission denied")


def test_existing_results_survive_a_failure(
    tmp_path: Path, tiny_generator: None, scenectl: Callable[..., object], monkeypatch: pytest.MonkeyPatch
) -> None:
    task, out = write(tmp_path, ""), tmp_path / "out"
    assert scenectl("run", task, "-o", out, "--no-preview", "--allow-unmet").status == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    one_sentence(scenectl("run", task, "-o", out, "--no-preview", "--seed", 9), "No space left")
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_results_that_are_none(tmp_path: Path, scenectl: Callable[..., object]) -> None:
    one_sentence(scenectl("view", tmp_path, "--png", tmp_path / "x.png"), "motion.npz")
    one_sentence(scenectl("view", "nowhere", "--png", tmp_path / "x.png"), "nowhere")


def test_no_screen_is_said_in_a_sentence(scenectl: Callable[..., object], monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    one_sentence(scenectl("view", "doorway"), "--png")
    monkeypatch.setattr("scenectl.view.stage._loads", lambda library: False)
    one_sentence(scenectl("view", "doorway", "--png", "x.png"), "libegl1")


def test_a_run_without_a_picture_keeps_its_motion(
    tmp_path: Path, tiny_generator: None, scenectl: Callable[..., object], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr("scenectl.view.stage._loads", lambda library: False)
    said = scenectl("run", write(tmp_path, ""), "-o", tmp_path / "out", "--allow-unmet")
    assert said.status == 0
    assert "no preview.png" in said.err and "Traceback" not in said.err
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"motion.npz", "report.json"}


def test_goals_and_benches(tmp_path: Path, scenectl: Callable[..., object]) -> None:
    one_sentence(scenectl("goals", "joint_tagret"), "joint_target")
    one_sentence(scenectl("goals", "--allow-code", tmp_path / "nope.py"), "does not exist")
    one_sentence(scenectl("bench", "progmogen", "--task", "hsi9"), "hsi")
    one_sentence(scenectl("train", "tokeniser"), "tokenizer")


def test_the_installed_command_keeps_its_word(tmp_path: Path) -> None:
    code = "from scenectl.cli.app import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "check", str(tmp_path / "nope.toml")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.strip() == f"scenectl: task file '{tmp_path / 'nope.toml'}' does not exist"


def test_errors_in_a_scene_of_doubtful_size_tell_the_doubt(scenectl: Callable[..., Any], tmp_path: Path) -> None:
    trimesh.creation.box(extents=[400, 350, 260]).export(tmp_path / "room.obj")
    (tmp_path / "task.toml").write_text(HEAD + "start = [900.0, 0.0]\n[scene]\nfile = 'room.obj'\n")
    doubt = 'centimetres, z up? state unit = "cm", up = "z"'
    assert doubt in scenectl("bake", tmp_path / "room.obj", "--resolution", "32").err
    said = scenectl("check", tmp_path / "task.toml")
    assert said.status == 2 and "outside the scene" in said.err and doubt in said.err
