"""The house keeps its measures: a function fits a screen."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("scenes", "objectives", "scenectl")
SCREEN = 45
"""Lines of a function's body at most, its docstring left out."""


def bodies(path: Path) -> list[tuple[str, int]]:
    """Every function of a file with the lines of its body."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body[1:] if ast.get_docstring(node) else node.body
            found.append((node.name, body[-1].end_lineno - body[0].lineno + 1 if body else 0))  # type: ignore[operator]
    return found


@pytest.mark.parametrize("package", PACKAGES)
def test_a_function_fits_a_screen(package: str) -> None:
    long = [
        f"{path.relative_to(ROOT)}: {name} has {lines} lines"
        for path in sorted((ROOT / package).rglob("*.py"))
        for name, lines in bodies(path)
        if lines > SCREEN
    ]
    assert not long, "\n".join(long)
