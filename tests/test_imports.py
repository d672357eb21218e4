"""The three packages import in one direction, and what only one feature needs is imported by that feature."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ALLOWED = {
    "scenes": {"scenes"},
    "objectives": {"scenes", "objectives"},
    "scenectl": {"scenes", "objectives", "scenectl"},
}
HEAVY = ("pyvista", "vtk", "open3d", "igl", "skimage", "manifold3d", "transformers", "sentence_transformers")


def imported(path: Path) -> set[str]:
    """Top-level names of every import in a file, those inside functions too."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.parametrize("package", ALLOWED)
def test_imports_point_one_way(package: str) -> None:
    files = sorted((ROOT / package).rglob("*.py"))
    assert files, f"no files in {package}"
    for path in files:
        backwards = (imported(path) & set(ALLOWED)) - ALLOWED[package]
        assert not backwards, f"{path.relative_to(ROOT)} imports {backwards}"


def test_the_command_line_starts_without_what_only_one_command_needs() -> None:
    code = f"import sys, scenectl.cli.app; print([name for name in {(*HEAVY, 'trimesh')!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("package", ALLOWED)
def test_import_is_light(package: str) -> None:
    code = f"import sys, {package}; print([name for name in {HEAVY!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]", f"importing {package} pulls in {done.stdout.strip()}"
