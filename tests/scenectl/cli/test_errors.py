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
    "a scene that is a folder": ('scene = "."', "is a folder; give a file"),
    "a scene that is a device": ('scene = "/dev/null"', "is a device; give a file"),
    "a scene with a name of no file": (f'scene = "{"x" * 3000}"', "xxx...' is neither a bundled scene"),
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
    "arrival before the start": ("[walk]\nto = [0.0, 2.0]\narrive = -1.0", "'arrive' is -1 s"),
    "arrival at the start": ("[walk]\nto = [0.0, 2.0]\narrive = 0", "'arrive' is 0 s"),
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
    "self as a key": ("self = 1", "unknown key 'self'"),
    "cls as a key": ("cls = 1", "unknown key 'cls'"),
    "self in a scene": ("[scene]\nself = 1", "self"),
    "self in a goal": ('[[goal]]\nuse = "foot_contact"\nself = 1', "self"),
    "self in a shape": ('[[scene.primitives]]\nshape = "sphere"\nself = 1', "self"),
    "self in a motion": (
        '[[scene.primitives]]\nshape = "sphere"\nradius = 1\ncenter = [0, 5, 0]\n'
        "motion = {self = 1}", "'times'"),
    "self in a generator": ("[generator]\nself = 1", "self"),
    "a center beyond floats": (
        f'[[scene.primitives]]\nshape = "box"\ncenter = [{10**400}, 0, 0]\nsize = [1, 1, 1]', "center"),
    "a far place": ("start = [1e200, 0.0]", "start.position"),
    "a vast radius": ('[[scene.primitives]]\nshape = "sphere"\ncenter = [0, 0, 0]\nradius = 1e15', "radius"),
    "shapes far apart": (
        '[scene]\nprimitives = [{shape = "sphere", center = [0, 0, 0], radius = 1.0}, '
        '{shape = "sphere", center = [1e8, 0, 0], radius = 1.0}]', "wide"),
    "a far object": (
        '[[scene.objects]]\nprimitive = {shape = "box", center = [0, 0, 0], size = [1, 1, 1]}\ntimes = [0]\n'
        "positions = [[1e30, 0, 0]]", "positions"),
    "a weight beyond floats": (f'[[goal]]\nuse = "foot_contact"\nweight = {10**308}', "weight"),
    "a vast weight": ('[[goal]]\nuse = "foot_contact"\nweight = 1e30', "weight"),
    "threads of 20 digits": ("[generator]\nthreads = 99999999999999999999", "threads"),
    "a seed of 20 digits": ("seed = 99999999999999999999", "seed"),
    "an infinite heading": ("start = {position = [0, 0], heading = inf}", "heading"),
    "an infinite cfg": ("[generator]\ncfg = inf", "cfg"),
    "a vast cfg": ("[generator]\ncfg = 1e308", "cfg"),
    "a temperature of nothing": ("[generator]\ntemperature = 1e-300", "temperature"),
    "a vast guidance": ("[guidance]\nscale = 1e308", "scale"),
    "a wider map than can be made": (
        'walk = {to = [0.0, 1.0]}\n[scene]\nprimitives = [{shape = "sphere", center = [-900, 5, -900], radius = 1.0}, '
        '{shape = "sphere", center = [900, 5, 900], radius = 1.0}]', "too large for ways"),
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
        ('prompt = "x"\nseconds = 120.5\n', "seconds"),
        ('prompt = "x"\nwalk = {to = [0.0, 2.0], arrive = 1e6}\n', "state more 'seconds'"),
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


NUMBERS = {
    "seconds": "seconds = {}",
    "samples": "samples = {}",
    "seed": "seed = {}",
    "position": "start = [{}, 0.0]",
    "heading": "start = {{position = [0.0, 0.0], heading = {}}}",
    "to": "walk = {{to = [0.0, {}]}}",
    "radius": "walk = {{to = [0.0, 1.0], radius = {}}}",
    "arrive": "walk = {{to = [0.0, 1.0], arrive = {}}}",
    "floor": "[scene]\nfloor = {}",
    "spacing": "[scene]\nbundled = 'doorway'\nspacing = {}",
    "thickness": "[scene]\nbundled = 'doorway'\nthickness = {}",
    "resolution": "[scene]\nbundled = 'doorway'\nresolution = {}",
    "size": "[[scene.primitives]]\nshape = 'box'\ncenter = [0, 5, 0]\nsize = [1, {}, 1]",
    "yaw": "[[scene.primitives]]\nshape = 'box'\ncenter = [0, 5, 0]\nsize = [1, 1, 1]\nyaw = {}",
    "weight": "[[goal]]\nuse = 'foot_contact'\nweight = {}",
    "tolerance": "[[goal]]\nuse = 'foot_contact'\ntolerance = {}",
    "window": "[[goal]]\nuse = 'foot_contact'\nwindow = [0.0, {}]",
    "height": "[[goal]]\nuse = 'head_height'\nheight = {}",
    "center": "[[goal]]\nuse = 'sphere_repulsion'\ncenter = [0, {}, 5]\nradius = 1.0",
    "cfg": "[generator]\ncfg = {}",
    "top_p": "[generator]\ntop_p = {}",
    "iterations": "[solver]\niterations = {}",
    "step": "[solver]\nstep = {}",
    "scale": "[guidance]\nscale = {}",
}
"""A number of every table of a task."""


@pytest.mark.parametrize("key", NUMBERS)
def test_what_is_no_number_is_told_for_every_key(key: str, tmp_path: Path, scenectl: Callable[..., object]) -> None:
    head = HEAD.replace("seconds = 4.0\n", "") if key == "seconds" else HEAD
    for word in ("nan", "inf", "-inf", "true", '"1"', "1e300", str(10**400)):
        one_sentence(scenectl("check", write(tmp_path, NUMBERS[key].format(word), head)), key)


@pytest.mark.parametrize(
    "words",
    [
        ("run", "TASK", "-o", "out", "--seed", "9" * 20),
        ("bake", "doorway", "--thickness", "nan"),
        ("bake", "doorway", "--spacing", "inf"),
        ("bake", "doorway", "--spacing", "1e-300"),
        ("bake", "doorway", "--resolution", "9" * 30),
        ("train", "all", "--iterations", "9" * 20),
        ("body", "none.glb", "--coverage", "nan"),
        ("bench", "rooms", "--seed", "9" * 20),
        ("bench", "building", "--spacing", "1e308"),
    ],
    ids=" ".join,
)
def test_numbers_of_options_are_bounded(
    words: tuple[str, ...], tmp_path: Path, scenectl: Callable[..., object]
) -> None:
    task = write(tmp_path, "")
    one_sentence(scenectl(*(task if word == "TASK" else word for word in words)), words[-2].removeprefix("--"))


def test_bodies_and_scenes_that_are_no_files(tmp_path: Path, scenectl: Callable[..., object]) -> None:
    os.mkfifo(tmp_path / "pipe.glb")
    os.mkfifo(tmp_path / "pipe.json")
    for name, word in (("pipe.glb", "pipe"), (".", "folder"), ("/dev/zero", "device"), ("x" * 3000 + ".glb", "read")):
        for line in (f"scene = '{name}'", f"[scene]\nfile = '{name}'", f"body = '{name.replace('glb', 'json')}'"):
            if line.startswith("scene =") and "." not in name.strip("."):
                continue  # a word without a dot names a bundled scene
            one_sentence(scenectl("check", write(tmp_path, line)), word)
    for name, word in (("pipe.glb", "pipe"), ("/dev/zero", "device")):
        one_sentence(scenectl("check", tmp_path / name), word)


def test_large_scenes_are_planned_on_a_coarser_map_which_is_said(
    tmp_path: Path, scenectl: Callable[..., object]
) -> None:
    ball = '{{shape = "sphere", center = [{0}, 5, {0}], radius = 1.0}}'
    text = (
        f"start = [0.0, 0.0]\nwalk = {{to = [0.0, 3.0]}}\n[scene]\nprimitives = [{ball.format(-44)}, {ball.format(44)}]"
    )
    said = scenectl("check", write(tmp_path, text))
    assert said.status == 0 and "90 x 90 m" in said.err and "cells of 9 cm" in said.err  # type: ignore[attr-defined]
