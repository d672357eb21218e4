"""The only way in which scenectl runs a user's code: task files are data."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from objectives import goals
from scenectl.tasks.actions import actions
from scenes.errors import UserError


def allow_code(path: str | Path) -> list[str]:
    """Run a Python file whose `@goal` and `@action` functions shall be known to tasks; returns the names it added.

    The only way in which scenectl runs a user's code: task files are data.
    """
    path = Path(path)
    if not path.is_file():
        raise UserError(f"code file '{path}' does not exist")
    before = _known()
    spec = importlib.util.spec_from_file_location(f"scenectl_allowed_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise UserError(f"code file '{path}' is not a Python file")
    try:
        spec.loader.exec_module(importlib.util.module_from_spec(spec))
    except UserError as error:
        raise UserError(f"code file '{path}': {error}") from error
    except Exception as error:
        raise UserError(f"code file '{path}' failed: {type(error).__name__}: {error}") from error
    return sorted(_known() - before)


def _known() -> set[str]:
    """Names of all goals and actions."""
    return {spec.name for spec in goals()} | {spec.name for spec in actions()}
