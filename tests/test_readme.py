"""What the README shows runs as it stands, beside stand-ins for the reader's own files."""

from __future__ import annotations

import re
import shlex
import shutil
import tomllib
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import typer

from objectives import forget
from scenectl.cli import COMMANDS
from scenectl.cli.root import commands as group
from scenectl.tasks.task import Task, load_task

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def fences(*languages: str) -> list[str]:
    found = re.findall(r"^```(\w*)\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
    return [text for language, text in found if language in languages]


def spans() -> list[str]:
    """Code within sentences and tables, where a bar is escaped."""
    prose = re.sub(r"^```.*?^```$", "", TEXT, flags=re.MULTILINE | re.DOTALL)
    return [span.replace("\\|", "|").replace("\n", " ") for span in re.findall(r"`([^`]+)`", prose)]


def commands() -> list[list[str]]:
    """Every `scenectl` command line, each choice of `a|b` on its own; `…` goes on from the line before."""
    lines = [line.split("#")[0] for fence in fences("sh", "") for line in fence.splitlines()]
    found: list[list[str]] = []
    for line in [*lines, *spans()]:
        words = shlex.split(line)
        if words[:1] == ["…"] and len(words) > 1 and words[1].startswith("--"):
            words = ["scenectl", *found[-1], *words[1:]]
        if words[:1] == ["scenectl"] and len(words) > 1:
            found += [list(choice) for choice in product(*(_choices(word) for word in words[1:]))]
    return found


def _choices(word: str) -> list[str]:
    return word.split("|") if re.fullmatch(r"[a-z|-]+", word) else [word]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """With a room, a home, a cart and a clip, as the README has files of its reader."""
    import trimesh

    room = trimesh.creation.box(bounds=[[-3, -3, 0], [3, 3, 2.5]])  # z up
    room.invert()
    room.export(tmp_path / "scan.ply")
    home = trimesh.Scene()
    home.add_geometry(trimesh.creation.box(bounds=[[-3, -0.1, -3], [3, 0, 3]]), "floor", "floor")
    home.add_geometry(trimesh.creation.box(bounds=[[0, 0, 0], [0.5, 0.9, 0.5]]), "chair", "chair")
    home.export(tmp_path / "home.glb")
    shutil.copy(ROOT / "examples" / "tasks" / "cart.glb", tmp_path)
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "examples" / "clips" / "wave.bvh", tmp_path)
    return tmp_path


@pytest.mark.parametrize("index", range(len(fences("toml"))))
def test_tables_are_tasks(index: int, folder: Path) -> None:
    """Parts of tasks as well: with a sentence and a length where they have none."""
    text = fences("toml")[index]
    table = tomllib.loads(text)
    own_length = "walk" in table or isinstance(table.get("prompt"), list)
    head = (
        {"prompt": 'prompt = "x"\n', "seconds": "" if own_length else "seconds = 5.0\n"}
        if "action" not in table
        else {}
    )
    (folder / "task.toml").write_text("".join(line for key, line in head.items() if key not in table) + text)
    setup = load_task(folder / "task.toml").build()
    assert setup.objective.terms or not setup.scene.meshes


def test_python_and_toml_are_one_task(monkeypatch: pytest.MonkeyPatch) -> None:
    import scenectl as sc

    class Result:
        def save(self, folder: str) -> None:
            assert folder == "out/dining"

    made: list[Task] = []

    def run(task: Task, samples: int) -> Result:
        assert samples == 4
        made.append(task)
        return Result()

    monkeypatch.setattr(sc, "run", run)
    exec(compile(fences("python")[0], "README.md", "exec"), {})
    (task,), table = made, tomllib.loads(fences("toml")[0])
    other = Task(**table)
    for mine, theirs in zip((facts(task), made_of(task)), (facts(other), made_of(other)), strict=True):
        assert mine == theirs


def facts(task: Task) -> dict[str, Any]:
    return {key: value for key, value in task.dump().items() if key != "scene"}


def made_of(task: Task) -> tuple[object, ...]:
    setup = task.build()
    return setup.scene.digest, setup.start, setup.seconds, setup.objective.terms


@pytest.mark.parametrize("index", range(len(fences("python"))))
def test_python_runs(index: int, folder: Path) -> None:
    from scenectl.generators import load_generator
    from scenes.errors import UserError

    text = fences("python")[index]
    if "sc.run" in text:
        try:
            load_generator()
        except UserError as error:
            pytest.skip(f"needs the shipped weights: {error}")
    try:
        exec(compile(text, "README.md", "exec"), {})
    finally:
        for name in re.findall(r"^@sc\.goal.*\ndef (\w+)", text, re.MULTILINE):
            forget(name)
    assert "result.save" not in text or (folder / "out/dining/preview.png").is_file()


def described() -> Iterator[tuple[Any, list[str]]]:
    """Each command line's command, and what it is given."""
    root: Any = typer.main.get_command(group(*COMMANDS))  # of the click that comes with typer
    for words in commands():
        command, rest = root, words
        while hasattr(command, "get_command") and rest and not rest[0].startswith("-"):
            found = command.get_command(command.context_class(command), rest[0])
            assert found is not None, f"README: 'scenectl {' '.join(words)}': there is no '{rest[0]}'"
            command, rest = found, rest[1:]
        yield command, rest


def flags(command: Any) -> set[str]:
    return {flag for parameter in command.params for flag in (*parameter.opts, *parameter.secondary_opts)}


def test_commands_and_their_flags_exist() -> None:
    everything, count = {"--help", "--install-completion"}, 0
    for command, rest in described():
        count += 1
        known = flags(command) | {"--help", "--install-completion"}
        everything |= known
        for flag in (word for word in rest if word.startswith("-")):
            assert flag in known, f"README: 'scenectl {command.name}' has no {flag}"
    assert count > 40
    for span in spans():
        if span.startswith("--"):
            assert span.split()[0] in everything, f"README: no command has {span}"


def test_makes_exist() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    wanted = {line.split()[1] for fence in fences("sh") for line in fence.splitlines() if line.startswith("make ")}
    assert wanted and wanted <= targets
