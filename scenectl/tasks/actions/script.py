"""Scripts: actions one after the other, each planned from where the one before leaves the body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from objectives import Term
from objectives.parameters import moved
from scenectl.generators.prompts import Prompts
from scenectl.tasks.actions.registry import KEYS, ActionSpec, get_action
from scenectl.tasks.actions.state import Act, State, World
from scenes.errors import UserError, shown
from scenes.motion.frames import Place


@dataclass(frozen=True)
class Entry:
    """One thing that is done, after the one before it.

    Attributes:
        number: its place in the script, from 1.
        spec: the action.
        parameters: converted and checked.
        name: for reports; the action's where it states none.
        goals: of its [[action.goal]] tables; their times are seconds of the act.
    """

    number: int
    spec: ActionSpec
    parameters: Mapping[str, Any]
    name: str
    goals: tuple[Term, ...] = ()

    @classmethod
    def of(cls, number: int, table: Any, folder: Path | None = None) -> Entry:
        """Read a table; raises UserError naming the entry for what is wrong with it."""
        if not isinstance(table, Mapping):
            raise UserError(f"action {number} must be an [[action]] table, not {shown(table)}")
        if not isinstance(table.get("do"), str):
            raise UserError(f"action {number} needs 'do' with the name of an action, such as do = \"walk\"")
        name = table.get("name", table["do"])
        if not isinstance(name, str) or not name.strip():
            raise UserError(f"action {number}: 'name' must be a text, not {shown(name)}")
        try:
            spec = get_action(table["do"])
            given = {key: value for key, value in table.items() if key not in KEYS}
            goals = tuple(Term.from_table(goal, folder) for goal in _goals(table.get("goal", ())))
            return cls(number, spec, spec.validate(given, folder, f"'{spec.name}'"), name, goals)
        except UserError as error:
            raise UserError(f"action {number}: {error}") from error

    @property
    def label(self) -> str:
        """How errors and reports name it."""
        return f"action {self.number} ('{self.name}')"

    def moved(self, by: Place) -> Entry:
        """The same where everything lies so much (m) further."""
        hints = self.spec.parameters
        further = {key: moved(hints[key].hint, value, by) for key, value in self.parameters.items()}
        return replace(self, parameters=further, goals=tuple(goal.moved(by) for goal in self.goals))

    def act(self, world: World, state: State) -> Act:
        """What it comes to from a state; raises UserError naming the entry where it cannot be done."""
        try:
            act = self.spec(world, state, **self.parameters)
        except UserError as error:
            raise UserError(f"{self.label}: {error}") from error
        if not act.seconds > 0:
            raise UserError(f"{self.label}: lasts {act.seconds:g} s; an act takes time")
        return act


def _goals(tables: Any) -> Sequence[Mapping[str, Any]]:
    """[[action.goal]] tables; raises UserError for anything else."""
    if not isinstance(tables, list | tuple) or not all(isinstance(table, Mapping) for table in tables):
        raise UserError(f"'goal' must be [[action.goal]] tables, not {shown(tables)}")
    return tables


@dataclass(frozen=True)
class Stretch:
    """An act on the clock of its script, from `begin` to `end` (s); and the state that it begins in."""

    entry: Entry
    begin: float
    end: float
    act: Act
    before: State

    @property
    def terms(self) -> tuple[Term, ...]:
        """Its goals on the script's clock."""
        goes_on = self.before.holds if self.act.then.holds == self.before.holds else ()
        here = (term.during(self.begin, self.end) for term in (*self.act.terms, *goes_on, *self.entry.goals))
        return tuple(replace(term, name=f"{self.entry.number} {self.entry.name}: {term.name}") for term in here)


@dataclass(frozen=True)
class Script:
    """Acts one after the other."""

    stretches: tuple[Stretch, ...]

    @property
    def seconds(self) -> float:
        return self.stretches[-1].end

    @property
    def prompts(self) -> Prompts:
        """The sentences of all acts with their times."""
        return Prompts(tuple(prompt for one in self.stretches for prompt in one.act.prompts(one.begin, one.end)))

    @property
    def terms(self) -> tuple[Term, ...]:
        """The goals of all acts."""
        return tuple(term for one in self.stretches for term in one.terms)

    @property
    def touches(self) -> dict[str, list[tuple[float, float]]]:
        """Joints whose part of the body may touch the scene, and from when to when (s)."""
        found: dict[str, list[tuple[float, float]]] = {}
        for one in self.stretches:
            stated = {joint: (one.begin + a, one.begin + b) for joint, (a, b) in one.act.touches.items()}
            stays = one.before.touches if one.act.then.touches == one.before.touches else ()
            for joint, window in (dict.fromkeys(stays, (one.begin, one.end)) | stated).items():
                found.setdefault(joint, []).append(window)
        return found

    @property
    def path(self) -> np.ndarray | None:
        """All planned ways one after the other, ``[P, 3]`` m; None where nothing walks."""
        ways = [one.act.path for one in self.stretches if one.act.path is not None]
        return np.concatenate(ways) if ways else None


def scripted(entries: Sequence[Entry], world: World, state: State) -> Script:
    """Plan a script from the state in which it begins.

    Raises:
        UserError: an action cannot be done from where the one before leaves the body; or all of them take longer than
            the generator's longest motion.
    """
    stretches, clock, frame = list[Stretch](), 0.0, 1 / world.spec.fps
    for entry in entries:
        if stretches and stretches[-1].act.last:
            raise UserError(
                f"{entry.label}: nobody knows where {stretches[-1].entry.label} leaves the body, as it does not stay; "
                "let it stay, or end the script with it"
            )
        act = entry.act(world, state)
        end = round(round((clock + act.seconds) / frame) * frame, 6)  # acts begin and end at frames
        stretches.append(Stretch(entry, clock, end, act, state))
        clock, state = end, act.then
    script, longest = Script(tuple(stretches)), world.spec.longest
    if script.seconds > longest:
        told = next(one for one in stretches if one.end > longest)
        raise UserError(
            f"{told.entry.label} ends at {told.end:.1f} s, and a motion lasts {longest:g} s at most; end the script "
            "before it"
        )
    if (short := world.spec.shortest - script.seconds) > 1e-9:
        last = stretches[-1]
        raise UserError(
            f"the script lasts {script.seconds:.2f} s, and a motion lasts {world.spec.shortest:g} s at least; make "
            f"{last.entry.label} {short:.2f} s longer, or add an action"
        )
    return script
