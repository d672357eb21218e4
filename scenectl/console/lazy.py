"""Groups of commands whose files are read when a command is named, or listed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import typer
from typer.core import TyperGroup

from scenes.errors import UserError, shown
from scenes.numbers import LONGEST_WHOLE, MOST


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
    command = typer.main.get_command(alone)
    run: Any = command.callback
    named = {parameter.name: max(parameter.opts, key=len) for parameter in command.params}

    def checked(**given: Any) -> Any:
        for option, value in given.items():
            if isinstance(value, int | float) and not _meant(value):
                raise UserError(f"{named[option]} is {shown(value)}; give a finite number of a size that can be meant")
        return run(**given)

    command.callback = checked
    return command


def _meant(value: int | float) -> bool:
    """Whether a number of an option is finite, and as large as those of tables may be."""
    return abs(value) <= (LONGEST_WHOLE if isinstance(value, int) else MOST)
