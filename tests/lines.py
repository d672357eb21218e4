"""Lines of code by room, without blanks, comments and docstrings: python tests/lines.py [ROOT]."""

from __future__ import annotations

import ast
import io
import sys
import tokenize
from collections import Counter
from pathlib import Path

SILENT = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER,
}  # fmt: skip


def code_lines(path: Path) -> int:
    """Lines of a file on which some code stands."""
    source = path.read_text(encoding="utf-8")
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in SILENT:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            lines -= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return len(lines)


def main(root: Path) -> None:
    rooms: Counter[str] = Counter()
    for package in ("scenes", "objectives", "scenectl"):
        for path in (root / package).rglob("*.py"):
            rooms["/".join(path.relative_to(root).parts[:-1][:2])] += code_lines(path)
    for room, lines in sorted(rooms.items()):
        print(f"{lines:6} {room}")
    print(f"{sum(rooms.values()) - rooms['scenectl/bench']:6} the core, without scenectl/bench")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[1])
