"""docs/actions.md knows every action with all its parameters, and shows a picture of each."""

from __future__ import annotations

import re
from pathlib import Path

from scenectl.tasks.actions import actions

DOCS = Path(__file__).parents[4] / "docs"


def test_the_page_of_actions_has_a_row_for_each_with_its_parameters_and_a_picture() -> None:
    page = (DOCS / "actions.md").read_text(encoding="utf-8")
    rows = {row[0]: row for row in re.findall(r"^\| `(\w+)` \| (.*?) \| .* \| \[.*\]\((.*)\) \|$", page, re.MULTILINE)}
    for spec in actions():
        if spec.function.__module__.startswith("scenectl."):
            _, parameters, picture = rows.pop(spec.name)
            assert re.findall(r"`(\w+)`", parameters) == list(spec.parameters), spec.name
            assert (DOCS / picture).is_file(), picture
    assert not rows
