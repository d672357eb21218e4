"""Text from users is printed as it is: no markup, no emoji, and nothing that a terminal would obey."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, strategies as st

from scenectl.console import console
from scenes.errors import visible

HOSTILE = (
    "[/b]",
    "[red]x",
    "\\[/b]",
    ":smile:",
    "a\x1b[31mb",
    "\x07\x08",
    "[link=x]y[/link]",
    "\u202eevil",
    "x\r",
    "[",
)


def printed(write: Callable[[], None], monkeypatch: pytest.MonkeyPatch) -> str:
    text = io.StringIO()
    monkeypatch.setattr(console.out, "_file", text)
    monkeypatch.setattr(console.err, "_file", text)
    write()
    return text.getvalue()


@pytest.mark.parametrize("text", HOSTILE)
def test_every_way_of_printing_shows_text_as_it_is(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def table() -> None:
        lines = console.table("name", text)
        lines.add_row(text, "x")
        console.out.print(lines)

    def bar() -> None:
        with console.bars() as tell:
            tell(text, 0.5)

    row = {"rows": [{"name": text}], "summary": {text: {"name": text}}}
    ways: tuple[Callable[[], None], ...] = (
        lambda: console.out.print(text),
        lambda: console.err.print(f"scenectl: {text}"),
        lambda: console.doubt([text]),
        lambda: console.say(text, 0.5),
        lambda: console.out.print(console.titled(text, f": {text}")),
        lambda: console.show(row),
        table,
    )
    for way in ways:
        assert visible(text).strip() in printed(way, monkeypatch)
    assert "\x1b[31m" not in printed(bar, monkeypatch)


@given(st.text())
def test_visible_text_holds_nothing_that_a_terminal_obeys(text: str) -> None:
    shown = visible(text)
    assert all(c.isprintable() or c in "\n\t" for c in shown)
    assert visible(shown) == shown
    assert shown == text or any(not (c.isprintable() or c in "\n\t") for c in text)


TASK = 'prompt = "x"\nseconds = 2.0\n'


@pytest.mark.parametrize("name", ["[red].toml", ":smile:.toml", "b].toml", "[", "a\x1b[31mb\x07.toml", "b\udcff.toml"])
def test_names_of_files(name: str, tmp_path: Path, scenectl: Callable[..., Any]) -> None:
    (tmp_path / name).write_text(TASK)
    said = scenectl("check", tmp_path / name)
    assert said.status == 0 and visible(name) in said.out and "\x1b" not in said.out
    (tmp_path / name).write_text(f"{TASK}scene = '[/b]'\n")
    said = scenectl("check", tmp_path / name)
    assert said.status == 2 and "[/b]" in said.err and "Traceback" not in said.err
    said = scenectl("check", tmp_path / f"not {name}")
    assert said.status == 2 and visible(name) in said.err and "\x1b" not in said.err
