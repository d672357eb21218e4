"""What is fuzzed: for each kind of file how it is broken, and what reads it.

A `Target` writes one broken file (or folder) into an empty folder, and reads it as the program does, which may succeed
or raise UserError; anything else is a finding. Add a reader by adding a function to `TARGETS`.
"""

from __future__ import annotations

import io
import json
import os
import tempfile
import tomllib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import torch
import trimesh

from tests.fuzz import mutations

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "examples" / "tasks").glob("*.toml"))


@dataclass(frozen=True)
class Target:
    """A kind of file.

    Attributes:
        name: of the kind.
        write: puts a broken file, which a generator of random numbers decides, into a folder, and says which it is.
        read: reads it.
        share: of the inputs, relative to the others.
    """

    name: str
    write: Callable[[Random, Path], Path]
    read: Callable[[Path], object]
    share: int = 1


# ---- sound files, each made once --------------------------------------------------------------------------------


@cache
def room() -> trimesh.Trimesh:
    """A floor with a box on it."""
    parts = [trimesh.creation.box(extents=size) for size in ((4, 0.1, 4), (0.5, 1.0, 0.5))]
    parts[1].apply_translation([1.0, 0.5, 0.0])
    return trimesh.util.concatenate(parts)


@cache
def mesh_file(ending: str) -> bytes:
    """The room in a format."""
    if ending == "dae":
        from tests.scenes.body.test_rig import dae

        return dae().encode()
    if ending == "glb":
        scene = trimesh.Scene()
        scene.add_geometry(room(), node_name="room", transform=trimesh.transformations.rotation_matrix(0.3, [0, 1, 0]))
        return bytes(scene.export(file_type="glb"))
    made = trimesh.exchange.export.export_mesh(room(), file_type=ending, file_obj=None)
    return made.encode() if isinstance(made, str) else bytes(made)


@cache
def ascii_ply() -> bytes:
    return bytes(room().export(file_type="ply", encoding="ascii"))


@cache
def motion_arrays() -> dict[str, np.ndarray]:
    from scenes.motion.motion import Motion
    from tests.scenectl.small import walk

    return dict(np.load(io.BytesIO(written(Motion(walk(40)).save, "a.npz"))))


def written(save: Callable[[Path], object], name: str) -> bytes:
    """What a function writes to a path, whose ending the name has."""
    with tempfile.TemporaryDirectory() as folder:
        save(Path(folder) / name)
        return (Path(folder) / name).read_bytes()


@cache
def bvh() -> bytes:
    from scenectl.export.export import export
    from scenes.motion.motion import Motion
    from tests.scenectl.small import walk

    return written(lambda path: export(Motion(walk(40)), path), "a.bvh")


@cache
def grid_arrays() -> dict[str, np.ndarray]:
    from scenes.sdf.grid import SdfGrid

    values = torch.linspace(-0.5, 1.0, 125).reshape(5, 5, 5)
    return SdfGrid(values, torch.zeros(3, dtype=torch.float64), 0.1).arrays()


@cache
def block_arrays() -> dict[str, np.ndarray]:
    coarse = np.linspace(-0.5, 1.0, 27, dtype=np.float32).reshape(3, 3, 3)
    index = np.full((2, 2, 2), -1, np.int32)
    index[0, 0, 0] = 0
    blocks = {f"blocks{k + 1}": np.zeros((1 if k == 0 else 0, *((2 << k) + 1,) * 3), np.int16) for k in range(3)}
    numbers = {"origin": np.zeros(3), "spacing": np.array(0.05), "beyond": np.array(1.0), "margin": np.array(0.1)}
    return {"coarse": coarse, "index": index, **blocks, **numbers}


@cache
def character() -> bytes:
    from tests.scenes.body.rigs import humanoid

    return humanoid().bytes()


@cache
def body_table() -> Any:
    from scenes.body.body import DEFAULT_BODY
    from scenes.body.proxies import fit_proxies
    from scenes.body.urdf import read_urdf
    from tests.scenes.body.rigs import robot

    def save(path: Path) -> None:
        fit_proxies(read_urdf(robot(path.parent))).save(path)

    table = json.loads(written(save, "a.json"))
    return {**table, "body": json.loads(json.dumps(asdict(DEFAULT_BODY)))}


@cache
def weights_files() -> dict[str, bytes]:
    """A folder of tiny weights."""
    from scenectl.generators.mscot.bundle import PARTS, build
    from scenectl.generators.weights import Weights
    from scenectl.networks.checkpoint import save_weights
    from tests.scenectl.small import config

    settings = config(text_dim=1)
    about = settings.model_dump(mode="json")
    with tempfile.TemporaryDirectory() as folder:
        parts = {part: Path(folder) / f"{part}.safetensors" for part in PARTS}
        for network, path in zip(build(settings), parts.values(), strict=True):
            save_weights(network, path, {"config": about, "licence": "CC0-1.0"})
        Weights(Path(folder), "mscot", parts, about, "CC0-1.0").save()
        return {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir()) if path.is_file()}


# ---- tasks ------------------------------------------------------------------------------------------------------


def write_task(rng: Random, folder: Path) -> Path:
    """An example task with some of its tables broken; sometimes its text."""
    path = folder / "task.toml"
    text = rng.choice(EXAMPLES).read_text(encoding="utf-8")
    way = rng.randrange(10)
    if way == 0:
        path.write_bytes(mutations.words(rng, text.encode()))
    elif way == 1:
        path.write_bytes(mutations.binary(rng, text.encode()))
    else:
        table = mutations.table(rng, tomllib.loads(text), 4)
        path.write_bytes(mutations.toml(table).encode("utf-8", "replace"))
    return path


def special(rng: Random, folder: Path, name: str) -> Path:
    """What is no file: a pipe, a folder, a device, a ring of links, nothing, or an empty file."""
    path, way = folder / name, rng.randrange(6)
    if way == 0:
        os.mkfifo(path)
    elif way == 1:
        path.mkdir()
    elif way == 2:
        path.symlink_to("/dev/zero")
    elif way == 3:
        path.symlink_to(path)
    elif way == 4:
        path.write_bytes(b"")
    return path


def read_task(path: Path) -> None:
    """As `scenectl check` does; scenes that must be baked, and maps of the ground, are left to longer campaigns."""
    from scenectl.tasks.task import load_task

    task = load_task(path)
    scene = task.load_scene()
    task.load_body()
    quick = not scene.meshes and not scene.objects and task.walk is None and task.start != "sample"
    if (quick and not scene.primitives) or os.environ.get("FUZZ_DEEP"):
        task.build()


def write_recipe(rng: Random, folder: Path) -> Path:
    original = tomllib.loads((ROOT / "scenectl" / "configs" / "compact.toml").read_text(encoding="utf-8"))
    path = folder / "recipe.toml"
    path.write_bytes(mutations.toml(mutations.table(rng, original)).encode("utf-8", "replace"))
    return path


def read_recipe(path: Path) -> None:
    from scenectl.generators.mscot.training.stages import MSCoTRecipe
    from scenectl.training.recipe import family_of, load_recipe

    family_of(path)
    load_recipe(path, MSCoTRecipe)


# ---- shapes -----------------------------------------------------------------------------------------------------


def write_mesh(rng: Random, folder: Path) -> Path:
    ending = rng.choice(("glb", "obj", "ply", "stl", "off", "dae"))
    data = ascii_ply() if ending == "ply" and rng.random() < 0.5 else mesh_file(ending)
    text = ending in ("obj", "off", "dae") or data is ascii_ply()
    if ending == "glb" and rng.random() < 0.7:
        data = mutations.headed(rng, data, 12, "<I")
    elif text and rng.random() < 0.8:
        data = mutations.words(rng, data)
    else:
        data = mutations.binary(rng, data)
    path = folder / f"scene.{ending}"
    path.write_bytes(data)
    return path


def read_mesh(path: Path) -> None:
    from scenes.mesh.collada import read_collada
    from scenes.mesh.mesh import load_mesh, load_parts
    from scenes.mesh.reading import read_content
    from scenes.mesh.surface import Surface

    if path.suffix == ".dae":
        read_content(path, f"mesh file '{path}'", {"dae": read_collada})
        return
    Surface.of(load_mesh(path))
    load_parts(path)


def write_character(rng: Random, folder: Path) -> Path:
    path = folder / "person.glb"
    path.write_bytes(mutations.headed(rng, character(), 12, "<I"))
    if rng.random() < 0.2:
        path.write_bytes(mutations.binary(rng, character()))
    return path


def write_robot(rng: Random, folder: Path) -> Path:
    from tests.scenes.body.rigs import robot

    path = robot(folder)
    text = path.read_bytes()
    if rng.random() < 0.5:
        mesh = rng.choice(("1e300 1e300 1e300", "1e150 1 1", "0 0 0", "-1 1 1", "1e-300 1 1", "1 1", "nan 1 1"))
        (folder / "shape.stl").write_bytes(mesh_file("stl"))
        name = rng.choice(("shape.stl", "archive.zip", "pipe.stl", "/dev/zero", "package://x/shape.stl"))
        element = f'<link name="extra"><collision><geometry><mesh filename="{name}" scale="{mesh}"/></geometry>'
        text = text.replace(b"</robot>", f"{element}</collision></link></robot>".encode())
        (folder / "archive.zip").write_bytes(b"PK\3\4")
    path.write_bytes(mutations.words(rng, text) if rng.random() < 0.8 else mutations.binary(rng, text))
    return path


def read_character(path: Path) -> None:
    from scenectl.data.characters import load_character
    from scenes.body.proxies import fit_part
    from scenes.errors import UserError

    rig, _ = load_character(path)
    try:
        fit_part(rig.parts[0])
    except UserError as error:
        raise UserError(f"'{path}' {error}") from error


def write_body(rng: Random, folder: Path) -> Path:
    path = folder / "body.json"
    data = mutations.as_json(mutations.table(rng, body_table()))
    path.write_bytes(mutations.binary(rng, data) if rng.random() < 0.2 else data)
    return path


def read_body(path: Path) -> None:
    from scenes.body.proxies import Proxies
    from scenes.motion.motion import Motion

    found = Proxies.load(path)
    found.place(found.frames)
    if found.body is not None:
        found.body.points(Motion(torch.zeros(1, 22, 3)))


# ---- arrays -----------------------------------------------------------------------------------------------------


def npz(name: str, arrays: Callable[[], dict[str, np.ndarray]]) -> Callable[[Random, Path], Path]:
    """A writer of broken .npz files."""

    def write(rng: Random, folder: Path) -> Path:
        path = folder / name
        path.write_bytes(mutations.archive(rng, arrays()))
        return path

    return write


def read_motion(path: Path) -> None:
    from scenectl.data.formats.motions import read_motion

    read_motion(path)


def read_grid(path: Path) -> None:
    from scenes.sdf.grid import SdfGrid

    grid = SdfGrid.load(path)
    grid.distance(torch.zeros(3, 3))
    grid.lipschitz  # noqa: B018


def read_blocks(path: Path) -> None:
    from scenes.sdf.blocks import SdfBlocks

    SdfBlocks.load(path).distance(torch.zeros(3, 3))


def write_track(rng: Random, folder: Path) -> Path:
    path = folder / rng.choice(("track.npy", "track.npz"))
    joints = motion_arrays()["joints"][..., 0, :]
    if path.suffix == ".npz":
        path.write_bytes(mutations.archive(rng, {"positions": joints, "mask": np.ones(len(joints), bool)}))
        return path
    np.save(path, mutations.array(rng, joints))
    path.write_bytes(mutations.binary(rng, path.read_bytes()))
    return path


def read_track(path: Path) -> None:
    from objectives import Term

    Term("joint_target", {"joint": "pelvis", "track": {"kind": "array", "file": str(path)}})


def write_bvh(rng: Random, folder: Path) -> Path:
    path = folder / "motion.bvh"
    path.write_bytes(mutations.words(rng, bvh()) if rng.random() < 0.8 else mutations.binary(rng, bvh()))
    return path


def read_bvh(path: Path) -> None:
    from scenectl.data.formats.bvh import load_bvh

    load_bvh(path)


def write_weights(rng: Random, folder: Path) -> Path:
    """A folder of weights with one file broken: its table, a header, or bytes."""
    files = dict(weights_files())
    name = rng.choice(sorted(files))
    if name.endswith(".json"):
        files[name] = mutations.as_json(mutations.table(rng, json.loads(files[name])))
    elif name.endswith(".safetensors") and rng.random() < 0.7:
        files[name] = mutations.headed(rng, files[name], 0, "<Q")
    else:
        files[name] = mutations.binary(rng, files[name])
    for file, data in files.items():
        (folder / file).write_bytes(data)
    return folder


def read_weights(path: Path) -> None:
    from scenectl.generators.mscot.bundle import load_bundle
    from scenectl.generators.weights import described

    load_bundle(described(path))


def write_result(rng: Random, folder: Path) -> Path:
    """A folder of a result whose report is broken."""
    from scenectl.pipeline.tables import FORMAT

    np.savez(folder / "motion.npz", **{**motion_arrays(), "joints": motion_arrays()["joints"][None]})
    task = {"prompt": "a person walks", "seconds": 2.0, "scene": {}, "goals": [], "folder": None}
    samples = [{"name": "sample", "goals": [], "met": True, "path": [[0.0, 0.0, 0.0]]}]
    report = {"format": FORMAT, "task": task, "samples": samples, "walk": None}
    (folder / "report.json").write_bytes(mutations.as_json(mutations.table(rng, report)))
    return folder


def read_result(path: Path) -> None:
    from scenectl.pipeline.results import load_result

    load_result(path)


def not_a_file(rng: Random, folder: Path) -> Path:
    """No file where one is read."""
    return special(rng, folder, rng.choice([f"input{ending}" for ending in _READERS]))


_READERS: dict[str, Callable[[Path], object]] = {
    ".toml": read_task, ".json": read_body, ".glb": read_mesh, ".obj": read_mesh, ".ply": read_mesh,
    ".urdf": read_character, ".npz": read_motion, ".bvh": read_bvh, ".npy": read_track,
}  # fmt: skip


def read_any(path: Path) -> None:
    """By its ending, and as part of a task."""
    from scenes.errors import UserError

    with suppress(UserError):
        _READERS[path.suffix](path)
    task = path.parent / "using.toml"
    task.write_text(f'prompt = "x"\nseconds = 2.0\nbody = "{path.name}"\n[scene]\nfile = "{path.name}"\n')
    read_task(task)


TARGETS = (
    Target("task", write_task, read_task, 8),
    Target("recipe", write_recipe, read_recipe),
    Target("mesh", write_mesh, read_mesh, 6),
    Target("character", write_character, read_character, 3),
    Target("robot", write_robot, read_character, 3),
    Target("body", write_body, read_body, 2),
    Target("motion", npz("motion.npz", motion_arrays), read_motion, 2),
    Target("track", write_track, read_track, 2),
    Target("bvh", write_bvh, read_bvh, 3),
    Target("grid", npz("grid.npz", grid_arrays), read_grid),
    Target("blocks", npz("blocks.npz", block_arrays), read_blocks),
    Target("weights", write_weights, read_weights, 2),
    Target("report", write_result, read_result, 2),
    Target("no file", not_a_file, read_any),
)


def chosen(seed: int) -> tuple[Target, Random]:
    """The target of a seed, and what decides its input."""
    rng = Random(seed)
    return rng.choices(TARGETS, [target.share for target in TARGETS])[0], rng
