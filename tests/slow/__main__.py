"""``python -m tests.slow`` (`make check-slow`): whether what is exported opens right in the tools that it is for.

Files, pictures and measurements are left in out/check-slow. What is not installed is skipped, and said.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image
from rich.console import Console
from rich.table import Table

from tests.slow.cases import Case, exported, files

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
BLENDER = ROOT / ".venv-blender" / "bin" / "python"
VALIDATOR = ROOT / ".node" / "node_modules"
CLOSE = 1e-3
"""Metres by which anything may be off."""
WAIT = 60
"""Seconds that Godot may take over a file; where a script of it fails, it goes on for ever."""
SIDE = 280
"""Pixels of each picture in a sheet."""


@dataclass
class Row:
    """One line of the table."""

    tool: str
    file: str
    result: str
    fine: bool | None


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.slow", description=__doc__)
    parser.add_argument("-o", type=Path, default=ROOT / "out" / "check-slow", help="folder for files and pictures")
    parser.add_argument("--only", default="", help="files whose name has this in it")
    parser.add_argument("--sheet", type=Path, help="a PNG file for Blender's pictures beside one another")
    parser.add_argument("--tool", choices=[check.__name__ for check in CHECKS], help="one alone")
    given = parser.parse_args()
    out = given.o.resolve()
    out.mkdir(parents=True, exist_ok=True)
    cases = [exported(*file) for file in files(ROOT, out) if given.only in file[1].name]
    rows = [row for check in CHECKS if given.tool in (None, check.__name__) for row in check(cases, out)]
    table = Table("tool", "file", "result", "")
    for row in rows:
        table.add_row(row.tool, row.file, row.result, {True: "ok", False: "FAILED", None: "skipped"}[row.fine])
    Console(width=max(100, Console().width)).print(table)
    if given.sheet:
        sheet([Path(case.picture) for case in cases if case.picture], given.sheet)
    sys.exit(any(row.fine is False for row in rows))


def blender(cases: list[Case], out: Path) -> Iterator[Row]:
    """Open all of it in Blender and measure where bones, meshes and things are."""
    if not BLENDER.exists():
        yield Row("Blender", "", f"no {BLENDER.relative_to(ROOT)}: `make check-slow` needs python3.11 to make it", None)
        return
    asked, found = out / "cases.json", out / "blender.json"
    asked.write_text(json.dumps([case.table() for case in cases]))
    said = subprocess.run([BLENDER, HERE / "blender.py", asked, found], capture_output=True, text=True)
    (out / "blender.log").write_text(said.stdout + said.stderr)
    if said.returncode:
        yield Row("Blender", "", f"stopped with {said.returncode}; see blender.log", False)
        return
    for case, result in zip(cases, json.loads(found.read_text()), strict=True):
        if "error" in result:
            yield Row("Blender", Path(case.file).name, result["error"].strip().splitlines()[-1], False)
            continue
        worst = ", ".join(f"{what} {1000 * off:.3f} mm" for what, off in result.items())
        yield Row("Blender", Path(case.file).name, worst, max(result.values()) <= CLOSE)


def validator(cases: list[Case], out: Path) -> Iterator[Row]:
    """Ask the Khronos validator about every GLB file."""
    paths = [case.file for case in cases if case.file.endswith(".glb")]
    if not (VALIDATOR.exists() and shutil.which("node")):
        yield Row("validator", "", "no gltf-validator: `make check-slow` needs node and npm to install it", None)
        return
    said = subprocess.run(
        ["node", HERE / "validate.cjs", *paths],
        env=os.environ | {"NODE_PATH": str(VALIDATOR)},
        capture_output=True,
        text=True,
        check=True,
    )
    (out / "validator.json").write_text(said.stdout)
    for path, issues in zip(paths, json.loads(said.stdout), strict=True):
        counts = [issues[f"num{kind}"] for kind in ("Errors", "Warnings", "Infos", "Hints")]
        said_of = sorted({message["code"] for message in issues["messages"]})
        text = "{} errors, {} warnings, {} infos, {} hints".format(*counts) + f" {said_of}" * bool(said_of)
        yield Row("validator", Path(path).name, text, counts[:2] == [0, 0])


def godot(cases: list[Case], out: Path) -> Iterator[Row]:
    """Import every GLB file into a project, and print where bones are while its animations play."""
    program = shutil.which("godot3-server")
    if program is None:
        yield Row("Godot", "", "no godot3-server; install it, as with `apt install godot3-server`", None)
        return
    chosen = [case for case in cases if case.file.endswith(".glb")]
    project = out / "godot"
    shutil.rmtree(project, ignore_errors=True)
    shutil.copytree(HERE / "godot", project)
    for case in chosen:
        shutil.copy(case.file, project)
    home = os.environ | {
        "HOME": str(out / "godot-home")
    }  # outside of the project, which it would look through for ever
    for name in [name for name in home if name.startswith("XDG_")]:
        del home[name]
    Path(home["HOME"]).mkdir(exist_ok=True)
    run = [program, "--path", str(project)]
    log = imported(project, run, home)
    for case in chosen:
        times = " ".join(f"{moment.time:.6f}" for moment in case.plays[0].moments)
        asked = home | {"SCENE": Path(case.file).name, "TIMES": times}
        said = subprocess.run([*run, "--script", "bones.gd"], env=asked, capture_output=True, text=True, timeout=WAIT)
        log += said.stdout + said.stderr
        yield godots(case, [line.split("\t") for line in said.stdout.splitlines()])
    (out / "godot.log").write_text(log)


def imported(project: Path, run: list[str], home: dict[str, str]) -> str:
    """Import what lies in a project; returns what the editor says.

    It writes a sum of each file once that is imported, and does not always end when it is told to quit.
    """
    wanted = len(list(project.glob("*.glb")))
    with (project.parent / "godot-editor.log").open("w+") as log:
        editor = subprocess.Popen([*run, "--editor", "--quit"], env=home, stdout=log, stderr=subprocess.STDOUT)
        until = time.monotonic() + WAIT * wanted
        while editor.poll() is None and time.monotonic() < until:
            if len(list(project.glob(".import/*.md5"))) >= wanted:
                break
            time.sleep(0.5)
        editor.kill()
        editor.wait()
        log.seek(0)
        return log.read()


def godots(case: Case, lines: list[list[str]]) -> Row:
    """What Godot's lines say: the animations it found, and how far bones are off where they should be."""
    found = {(line[1], line[2], plain(line[3])): np.array(line[4:], float) for line in lines if line[0] == "BONE"}
    lengths = {line[1]: float(line[2]) for line in lines if line[0] == "ANIMATION"}
    name = Path(case.file).name
    if missing := {plain(play.name) for play in case.plays} - set(map(plain, lengths)):
        return Row("Godot", name, f"lacks {sorted(missing)}; has {sorted(lengths)}", False)
    named, off = {plain(animation): animation for animation in lengths}, []
    for play in case.plays:
        for place, moment in enumerate(play.moments):
            for joint, (x, y, z) in moment.joints.items():
                here = found.get((named[plain(play.name)], str(place), plain(joint)))
                off.append(np.inf if here is None else np.linalg.norm(here - [x, z, -y]))
    text = f"{len(lengths)} animations of {max(lengths.values()):.2f} s, joints {1000 * max(off):.3f} mm"
    return Row("Godot", name, text, max(off) <= CLOSE)


def sheet(pictures: list[Path], path: Path) -> None:
    """Pictures beside one another in the order of a table of as many columns as rows, or one more, in few colours."""
    shown = [Image.open(picture).convert("RGB").resize((SIDE, SIDE)) for picture in pictures]
    columns = math.ceil(math.sqrt(len(shown)))
    whole = Image.new("RGB", (SIDE * columns, SIDE * math.ceil(len(shown) / columns)), "white")
    for place, picture in enumerate(shown):
        whole.paste(picture, (SIDE * (place % columns), SIDE * (place // columns)))
    whole.quantize(256, Image.Quantize.MAXCOVERAGE).save(path, optimize=True)


def plain(name: str) -> str:
    """A name as Godot 3 may have changed it: it makes spine_1 of spine1 and spine_01."""
    return re.sub(r"[^a-z0-9]|0+(?=\d)", "", name.lower())


CHECKS = (blender, validator, godot)

if __name__ == "__main__":
    main()
