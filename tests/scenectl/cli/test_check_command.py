"""`scenectl check`: every task is looked at, every sentence names its file, and what was added is told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from scenectl.cli.check import check

Run = Callable[..., Any]
HEAD = 'prompt = "a person walks"\nseconds = 4.0\n'
GROUND = HEAD + "start = [0.0, 0.0]\n"
SCENE = '[scene]\nprimitives = [{ shape = "sphere", center = [3.0, 1.0, 3.0], radius = 0.3 }]\n'
WALK = "[walk]\nto = [0.0, 2.0]\n"


def test_it_goes_on_after_a_task_that_is_wrong(scenectl: Run, tmp_path: Path) -> None:
    texts = {
        "key": HEAD + "sead = 1\n",
        "start": HEAD + "start = { position = [90.0, 0.0] }\n" + '[[scene.primitives]]\nshape = "sphere"\n'
        "center = [0, 1, 2]\nradius = 0.3\n",
        "goal": HEAD + '[[goal]]\nuse = "my_goal"\n',
        "weights": HEAD + '[generator]\nweights = "nowhere"\n',
        "fine": HEAD,
    }
    for name, text in texts.items():
        (tmp_path / f"{name}.toml").write_text(text)
    said = scenectl("check", *(tmp_path / f"{name}.toml" for name in texts), tmp_path / "gone.toml")
    lines = said.err.strip().splitlines()
    assert said.status == 2 and len(lines) == 5 and "Traceback" not in said.err
    for line, name in zip(lines, [*list(texts)[:-1], "gone"], strict=True):
        assert line.startswith(f"scenectl: task file '{tmp_path / name}.toml'"), line
    assert "unknown goal 'my_goal'" in lines[2] and "--allow-code FILE.py" in lines[2]
    assert f"{tmp_path / 'fine'}.toml: fine (4 s in 'empty'" in said.out
    assert scenectl("check", tmp_path / "fine.toml").status == 0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (GROUND + SCENE, "1 goal, sdf_penetration by default)"),
        (GROUND + SCENE + WALK, "7 goals, sdf_penetration and foot_contact by default, a walk of 2.0 m)"),
        (
            GROUND + SCENE + WALK + '[[goal]]\nuse = "sdf_penetration"\n',
            "7 goals, foot_contact by default, a walk of 2.0 m)",
        ),
        (GROUND + "avoid = false\n" + SCENE + WALK, "5 goals, a walk of 2.0 m)"),
        (GROUND + WALK, "7 goals, sdf_penetration and foot_contact by default, a walk of 2.0 m)"),
        (GROUND + "avoid = false\n" + WALK, "5 goals, a walk of 2.0 m)"),
        (GROUND, "0 goals)"),
    ],
)
def test_what_was_added_is_named(text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "task.toml").write_text(text)
    check([tmp_path / "task.toml"])
    assert said in " ".join(capsys.readouterr().out.split())
