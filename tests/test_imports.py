"""Packages and their rooms import in one direction, and what only one feature needs is imported by that feature."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from scenectl.bench.commands import BENCHES
from scenectl.cli import COMMANDS

ROOT = Path(__file__).resolve().parents[1]
ALLOWED = {
    "scenes": {"scenes"},
    "objectives": {"scenes", "objectives"},
    "scenectl": {"scenes", "objectives", "scenectl"},
}
ROOMS = {
    "scenes": [
        "errors",
        "numbers",
        "tables",
        "validation",
        "archive",
        "files",
        "kernels",
        "motion",
        "mesh",
        "authoring",
        "sdf",
        "body",
        "world",
        "scene",
        "bundled",
    ],
    "scenectl": [
        "version",
        "threads",
        "data",
        "networks",
        "training",
        "generators",
        "control",
        "evaluation",
        "measures",
        "tasks",
        "pipeline",
        "retarget",
        "export",
        "view",
        "api",
        "console",
        "bench",
        "cli",
    ],
}
"""Rooms of a package, the lowest first: each imports itself and those before it."""
COMPUTING = ("torch", "numpy", "scipy", "numba", "trimesh", "matplotlib")
"""What help and completion have no use for either."""
HEAVY = (
    "pyvista", "vtkmodules", "vtk", "open3d", "igl", "skimage", "manifold3d", "transformers",
    "sentence_transformers", "pxr", "pybvh", "pygltflib", "mujoco", "mink",
)  # fmt: skip


def imported(path: Path) -> set[str]:
    """Full names of all that a file imports, inside functions and for type checkers too; `from a import b` is a.b."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively, where this test does not look"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def room_of(name: str) -> str:
    """The second part of a dotted name."""
    return name.split(".")[1] if "." in name else ""


@pytest.mark.parametrize("package", ALLOWED)
def test_imports_point_one_way(package: str) -> None:
    files = sorted((ROOT / package).rglob("*.py"))
    assert files, f"no files in {package}"
    for path in files:
        backwards = ({name.split(".")[0] for name in imported(path)} & set(ALLOWED)) - ALLOWED[package]
        assert not backwards, f"{path.relative_to(ROOT)} imports {backwards}"


@pytest.mark.parametrize("package", ROOMS)
def test_rooms_import_one_way(package: str) -> None:
    rooms, wrong = ROOMS[package], []
    for path in sorted((ROOT / package).rglob("*.py")):
        room = path.relative_to(ROOT / package).parts[0].removesuffix(".py")
        if room == "__init__":
            continue  # the front of the package shows what is in all rooms
        assert room in rooms, f"{path.relative_to(ROOT)} is in no room of the table"
        above = rooms[rooms.index(room) + 1 :]
        seen = {name for name in imported(path) if name.split(".")[0] == package}
        strange = [name for name in seen if room_of(name) in above or room_of(name) not in rooms]
        wrong += [f"{path.relative_to(ROOT)} imports {name}" for name in sorted(strange)]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("package", ROOMS)
def test_no_modules_import_one_another_in_a_circle(package: str) -> None:
    files = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in sorted((ROOT / package).rglob("*.py"))
    }
    files.pop(package)  # the front of the package

    def module(name: str) -> str:
        return name if name in files or "." not in name else module(name.rpartition(".")[0])

    graph = {
        name: {module(other) for other in imported(path)} & (files.keys() - {name}) for name, path in files.items()
    }
    TopologicalSorter(graph).prepare()  # raises CycleError, which names the circle


def test_a_scene_without_meshes_needs_no_compiler() -> None:
    code = """import sys, torch, scenes
room = scenes.Scene([], [scenes.Box((0, 1, 0), (1, 1, 1))])
room.distance(torch.zeros(2, 3)), room.floor, scenes.Scene.empty().bounds, scenes.DEFAULT_BODY, scenes.Motion
print([name for name in ("numba", "scipy", "trimesh", "pydantic") if name in sys.modules])"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def loaded(*words: str, **environment: str) -> set[str]:
    """Top-level modules that the command line has imported when it ends, in a process of its own."""
    code = "import atexit, sys; atexit.register(lambda: print(*sys.modules, file=sys.stderr))\n"
    code += "from scenectl.cli.app import main; main()"
    env = {**os.environ, **environment}
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True, env=env)
    return {name.partition(".")[0] for name in done.stderr.splitlines()[-1].split()}


HELPS = [(), *((name,) for name in COMMANDS), *(("bench", name) for name in BENCHES)]
EACH_HELP = """import io, json, sys
from contextlib import redirect_stdout, suppress
from scenectl.cli.app import main
for words in json.loads(sys.argv[1]):
    sys.argv = ["scenectl", *words, "--help"]
    with suppress(SystemExit), redirect_stdout(io.StringIO()) as said:
        main()
    assert "Usage" in said.getvalue(), words
    assert not {name.partition(".")[0] for name in sys.modules} & set(%r), words"""


def test_help_imports_nothing_that_computes() -> None:
    code = EACH_HELP % ({*HEAVY, *COMPUTING},)
    done = subprocess.run([sys.executable, "-c", code, json.dumps(HELPS)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_completion_imports_nothing_that_computes() -> None:
    words = {"COMP_WORDS": "scenectl bench roo", "COMP_CWORD": "2"}
    assert not loaded(_SCENECTL_COMPLETE="complete_bash", **words) & {*HEAVY, *COMPUTING}


def test_a_check_without_a_mesh_imports_neither_a_compiler_nor_what_draws() -> None:
    modules = loaded("check", str(ROOT / "examples" / "tasks" / "barrier.toml"))
    assert "torch" in modules and "pydantic" in modules  # it does check
    assert not modules & {*HEAVY, "numba", "scipy", "trimesh", "safetensors", "tokenizers", "vtkmodules", "matplotlib"}


@pytest.mark.parametrize("package", ALLOWED)
def test_import_is_light(package: str) -> None:
    code = f"import sys, {package}; print([name for name in {HEAVY!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]", f"importing {package} pulls in {done.stdout.strip()}"
