"""Groups of commands whose files are read when a command is named, or listed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import typer
from typer.core import TyperGroup


def group(package: str, *names: str) -> type[TyperGroup]:
    """A class of group whose commands are files of a package, listed in this order.

    Each file holds a function of its own name, or, where it is a group again, an `app`.
    """

    class Group(TyperGroup):
        def __init__(self, **settings: Any) -> None:
            super().__init__(**settings)
            self.commands: Any = dict.fromkeys(names)  # what is listed, and what misspelt names are compared with

        def get_command(self, ctx: Any, cmd_name: str) -> Any:
            if cmd_name in names and self.commands[cmd_name] is None:
                self.commands[cmd_name] = _command(import_module(f"{package}.{cmd_name}"), cmd_name)
            return super().get_command(ctx, cmd_name)

    return Group


def _command(module: Any, name: str) -> Any:
    if hasattr(module, "app"):
        return typer.main.get_group(module.app)
    alone = typer.Typer(add_completion=False, rich_markup_mode=None)
    alone.command(name)(getattr(module, name))
    return typer.main.get_command(alone)
