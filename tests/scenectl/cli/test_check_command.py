"""`scenectl check` says what a task asks for that its file does not state."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenectl.cli.check import check

HEAD = 'prompt = "x"\nseconds = 4.0\nstart = [0.0, 0.0]\n'
SCENE = '[scene]\nprimitives = [{ shape = "sphere", center = [3.0, 1.0, 3.0], radius = 0.3 }]\n'
WALK = "[walk]\nto = [0.0, 2.0]\n"
OWN = '[[goal]]\nuse = "sdf_penetration"\n'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEAD + SCENE, "1 goal, sdf_penetration by default)"),
        (HEAD + SCENE + WALK, "7 goals, sdf_penetration and foot_contact by default, a walk of 2.0 m)"),
        (
            HEAD + SCENE + WALK + '[[goal]]\nuse = "sdf_penetration"\n',
            "7 goals, foot_contact by default, a walk of 2.0 m)",
        ),
        (HEAD + "avoid = false\n" + SCENE + WALK, "5 goals, a walk of 2.0 m)"),
        (HEAD + WALK, "5 goals, a walk of 2.0 m)"),
    ],
)
def test_what_was_added_is_named(text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "task.toml").write_text(text)
    check([tmp_path / "task.toml"])
    assert said in " ".join(capsys.readouterr().out.split())
