"""Random scripts that the planner finds feasible: every kind of action as often as the others, as far as that goes."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice
from typing import Any, TypeAlias

import numpy as np
import torch

from scenectl.generators.spec import Spec
from scenectl.measures.metrics import Scorer
from scenectl.tasks.actions.registry import actions, get_action
from scenectl.tasks.actions.script import Entry
from scenectl.tasks.actions.state import Act, State, World, turn as wrapped
from scenectl.tasks.schema import Start
from scenectl.tasks.setup import Setup
from scenectl.tasks.task import Task
from scenectl.tasks.walk import room_of
from scenes.body.body import DEFAULT_BODY
from scenes.errors import UserError
from scenes.mesh.primitives import Box
from scenes.world.floor.planning import FreeArea
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.named import named_scene
from scenes.world.scene import Scene
from scenes.world.seats import find_seat

SHORTEST, LONGEST = 2, 5
"""Actions of a script."""
NEAREST, FARTHEST = 1.0, 4.0
"""Metres as the crow flies from where one stands to where one walks."""
TURNS = (math.radians(30), math.radians(180))
"""By how much one turns, rad."""
CHAIRS = (0.35, 0.55)
"""Heights (m) over the ground of what is drawn as a seat; ours. `sit` takes tables and the arms of chairs as well."""
ARM = (0.35, 0.75)
"""Metres from the vertical through the pelvis to what is reached for; ours, less than `reach` takes."""
HIGH = (0.8, 1.5)
"""Metres over the ground of what is reached for."""
BESIDE = math.radians(45)
"""How far (rad) to either side of straight ahead one reaches; looks go to twice as far."""
CLEAR = 0.1
"""Metres that are free around what is reached for, and around the way there."""
STAYS = 0.5
"""Share of actions after which somebody who sits does something on the seat, where they could also get up."""
TRIES = 40
"""Draws after which a thing that is looked for counts as not there, and a scene as too small."""

SIZE = (0.24, 0.18, 0.18)
"""Of the parcel that is carried, m; ours."""
SHELVES = (0.55, 1.1)
"""Heights (m) over the ground of what it stands on: tables and shelves, not seats."""
PARCEL = "parcel"

WAVES = {
    "left": ("bandai: wave-left-hand", "bandai: bye", "bandai: byebye"),
    "right": ("bandai: wave-right-hand", "bandai: bye", "bandai: byebye"),
    "both": ("bandai: wave-both-hands",),
}
"""Kinds of the second classifier that show waving, by hand."""
SENTENCES = {
    "a person raises the left hand.": ("bandai: raise-up-left-hand",),
    "a person raises the right hand.": ("bandai: raise-up-right-hand",),
    "a person raises both hands.": ("bandai: raise-up-both-hands",),
    "a person bows.": ("bandai: bow",),
    "a person hops on the spot.": ("hop",),
    "a person crouches.": ("crouch", "sneak", "squat"),
    "a person kicks.": ("bandai: kick", "fight"),
    "a person punches.": ("bandai: punch", "fight"),
    "a person dances.": ("bandai: dance-short", "dance"),
}
"""What `act` is told, and the kinds of the second classifier that show it."""
SEATED, SITS = 3, "sits and "
"""So many of the sentences also serve somebody who sits, and how they then say so."""

Parameters: TypeAlias = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Room:
    """A scene in which scripts are drawn.

    Attributes:
        scene: which.
        world: the same with a body and a clock, as actions are told it.
        scorer: of the scene.
        sentences: that `act` may be told.
        hands: that may wave.
        shelves: places (m) on which the parcel can stand; it stands on the first.
    """

    scene: Scene
    world: World
    scorer: Scorer
    sentences: tuple[str, ...]
    hands: tuple[str, ...]
    shelves: tuple[list[float], ...] = ()

    @classmethod
    def of(cls, scene: str, spec: Spec, known: Collection[str]) -> Room:
        """The scene of that file or bundled name, for a generator and the kinds that a classifier knows."""
        found = named_scene(scene)
        sentences = tuple(text for text, kinds in SENTENCES.items() if set(kinds) & set(known))
        hands = tuple(hand for hand, kinds in WAVES.items() if set(kinds) & set(known))
        world = World(found, DEFAULT_BODY, spec)
        shelves = tuple(islice(_shelves(found, world.area(*room_of(DEFAULT_BODY))), TRIES))
        found = found.with_objects([*found.objects, *map(_parcel, shelves[:1])])
        return cls(found, World(found, DEFAULT_BODY, spec), Scorer(found), sentences, hands, shelves)

    @property
    def area(self) -> FreeArea:
        """Where the body can be."""
        return self.world.area(*room_of(self.world.body))

    @cached_property
    def seats(self) -> tuple[str | list[float], ...]:
        """Parts to sit on; of a scene that has none, points on its surfaces, as many as are found."""
        whole = {mesh.name for mesh in self.scene.meshes}
        named: tuple[str | list[float], ...] = tuple(
            name for name in sorted(self.scene.named) if name not in whole and self._seat(name)
        )
        return named or tuple(self._places_to_sit())

    def _seat(self, on: str | list[float]) -> bool:
        """Whether somebody can sit there as on a chair, and that thing carries them."""
        x, _, z = self.scene.bounds.mean(axis=0)
        try:
            seat = find_seat(self.scene, self.area, on, (float(x), 0.0, float(z)))
        except UserError:
            return False
        if not CHAIRS[0] <= seat.height <= CHAIRS[1]:
            return False
        part = self.scene.part(on) if isinstance(on, str) else self.scene
        return float(part.distance(torch.tensor([seat.hips]), torch.zeros(1))) < CLEAR / 2  # walls hold no sofa

    def _places_to_sit(self) -> Iterator[list[float]]:
        levels, (low, high) = self.scene.levels, CHAIRS
        heights = levels.heights - self.scene.floor.height
        cells = np.argwhere((heights >= low) & (heights <= high))
        for i, j, k in np.random.default_rng(0).permutation(cells)[:TRIES]:
            x, z = np.array([i, j]) * levels.cell + levels.origin
            place = _plain([x, levels.heights[i, j, k], z])
            if self._seat(place):
                yield place


def _parcel(place: Sequence[float]) -> MovingObject:
    """The parcel, on a place (m)."""
    x, y, z = place
    way = Trajectory((0.0,), ((x, y + SIZE[1] / 2 + 0.005, z),))
    return MovingObject(Box((0.0, 0.0, 0.0), SIZE), way, PARCEL)


def _shelves(scene: Scene, area: FreeArea) -> Iterator[list[float]]:
    """Level places of the size of the parcel with room over them, beside which somebody can stand."""
    levels, half = scene.levels, max(SIZE) / 2
    over = levels.heights - scene.floor.height
    cells = np.argwhere((over >= SHELVES[0]) & (over <= SHELVES[1]))
    corners = half * np.array([[a, 0.0, b] for a in (-1, 0, 1) for b in (-1, 0, 1)])
    around = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    for i, j, k in np.random.default_rng(0).permutation(cells)[: 50 * TRIES]:
        x, z = np.array([i, j]) * levels.cell + levels.origin
        place = np.array([x, levels.heights[i, j, k], z])
        below, above = place + corners - [0.0, CLEAR / 4, 0.0], place + corners + [0.0, CLEAR + half, 0.0]
        near = scene.distance(torch.from_numpy(np.concatenate([below, above])), torch.zeros(18, dtype=torch.float64))
        stands = (_plain([x + 0.55 * np.sin(a), scene.floor.height, z + 0.55 * np.cos(a)]) for a in around)
        fits = bool((near[:9] < CLEAR / 4).all() and (near[9:] > CLEAR).all())
        if fits and any(area.free((a, b, c)) for a, b, c in stands):
            yield _plain(place)


Draw: TypeAlias = Callable[[Room, State, np.random.Generator], Parameters | None]
"""Parameters of an action in a state; None where a room has nothing for it."""


def _walk(room: Room, state: State, rng: np.random.Generator) -> Parameters | None:
    here = np.array([state.place[0], state.place[2]])
    places = room.area.sample(TRIES, rng)
    away = np.linalg.norm(places - here, axis=1)
    fit = places[(away >= NEAREST) & (away <= FARTHEST)]
    return {"to": _plain(fit[0])} if len(fit) else None


def _turn(room: Room, state: State, rng: np.random.Generator) -> Parameters:
    return {"heading": round(wrapped(state.heading + float(rng.choice([-1, 1]) * rng.uniform(*TURNS))), 3)}


def _stand(room: Room, state: State, rng: np.random.Generator) -> Parameters:
    return {"seconds": round(float(rng.uniform(1.5, 4.0)), 1)}


def _sit(room: Room, state: State, rng: np.random.Generator) -> Parameters | None:
    return {"on": room.seats[rng.integers(len(room.seats))]} if room.seats else None


def _stand_up(room: Room, state: State, rng: np.random.Generator) -> Parameters:
    return {}


def _reach(room: Room, state: State, rng: np.random.Generator) -> Parameters | None:
    for _ in range(TRIES):
        point = _ahead(state, rng, ARM, BESIDE, HIGH)
        over = np.array([state.place[0], point[1], state.place[2]])
        way = torch.from_numpy(over + np.linspace(0, 1, 6)[:, None] * (np.array(point) - over)).float()
        if float(room.scene.distance(way, torch.zeros(len(way))).min()) > CLEAR:
            return {"to": point, "hand": str(rng.choice(["left", "right"]))}
    return None


def _look_at(room: Room, state: State, rng: np.random.Generator) -> Parameters | None:
    low, high = room.scene.bounds
    points = (_ahead(state, rng, (NEAREST, FARTHEST), 2 * BESIDE, HIGH) for _ in range(TRIES))
    return next(({"at": point} for point in points if (low < point).all() and (point < high).all()), None)


def _wave(room: Room, state: State, rng: np.random.Generator) -> Parameters | None:
    return {"hand": str(rng.choice(room.hands))} if room.hands else None


def _duck(room: Room, state: State, rng: np.random.Generator) -> Parameters:
    return {}


def _act(room: Room, state: State, rng: np.random.Generator) -> Parameters | None:
    fit = [s for s in room.sentences if state.posture == "standing" or s in list(SENTENCES)[:SEATED]]
    if not fit:
        return None
    said = str(rng.choice(fit))
    said = said if state.posture == "standing" else said.replace("a person ", f"a person {SITS}")
    return {"prompt": said, "seconds": 3.0}


def _pick_up(room: Room, state: State, rng: np.random.Generator) -> Parameters | None:
    free = room.shelves and not state.holds and PARCEL not in state.put
    return {"what": PARCEL, "hand": "both"} if free else None


def _carry(room: Room, state: State, rng: np.random.Generator) -> Parameters | None:
    return _walk(room, state, rng) if state.holds else None


def _put_down(room: Room, state: State, rng: np.random.Generator) -> Parameters | None:
    return {"to": room.shelves[rng.integers(len(room.shelves))]} if state.holds else None


DRAWS: dict[str, Draw] = {
    "walk": _walk,
    "turn": _turn,
    "stand": _stand,
    "sit": _sit,
    "stand_up": _stand_up,
    "reach": _reach,
    "look_at": _look_at,
    "wave": _wave,
    "duck": _duck,
    "act": _act,
    "pick_up": _pick_up,
    "carry": _carry,
    "put_down": _put_down,
}
"""How parameters of each kind of action are drawn; one that is registered and not here is left out, and said so."""


WITH_HANDS_FULL = ("carry", "put_down", "turn", "stand")
"""What somebody does who holds something."""


def _ahead(
    state: State,
    rng: np.random.Generator,
    away: tuple[float, float],
    beside: float,
    high: tuple[float, float],
) -> list[float]:
    """A point (m) before somebody: so far away, so much (rad) beside straight ahead, so high over the ground."""
    way, far = state.heading + rng.uniform(-beside, beside), rng.uniform(*away)
    x, y, z = state.place
    return _plain([x + far * math.sin(way), y + rng.uniform(*high), z + far * math.cos(way)])


def _plain(place: Sequence[float] | np.ndarray) -> list[float]:
    return [round(float(value), 3) for value in place]


@dataclass(frozen=True, eq=False)
class Drawn:
    """A script that the planner takes.

    Attributes:
        room: that it is for.
        tables: its [[action]] tables.
        task, setup: the same, to be run.
    """

    room: Room
    tables: tuple[Parameters, ...]
    task: Task
    setup: Setup

    @property
    def kinds(self) -> list[str]:
        return [table["do"] for table in self.tables]


@dataclass
class Scripts:
    """Draws scripts, one after the other.

    Each next action is of the kind that was drawn least often so far, among those that somebody can do in the posture
    in which the one before leaves them. Who sits down gets up before the script ends, and who takes something puts it
    down, so that both come equally often; who sits does something on the seat before that as often as not.
    What the planner refuses is a script that is rejected, and another action is drawn in its place.

    Attributes:
        rng: decides everything.
        spec: of the generator.
        counts: actions drawn so far, by kind.
        rejected: scripts, by reason.
    """

    rng: np.random.Generator
    spec: Spec
    counts: Counter[str] = field(default_factory=Counter)
    rejected: Counter[str] = field(default_factory=Counter)

    def draw(self, room: Room, seed: int = 0) -> Drawn:
        """A script in a room; raises UserError where none can be found."""
        for _ in range(TRIES):
            tables, start = self._tables(room)
            if not tables:
                continue
            x, _, z = start.place
            try:
                begin = Start(position=(x, z), heading=start.heading)
                task = Task(actions=tables, scene=room.scene, start=begin)
                setup = task.build(seed, scene=room.scene, spec=self.spec)
            except UserError as error:
                self.rejected[reason("script", error)] += 1
                continue
            self.counts.update(table["do"] for table in tables)
            return Drawn(room, tuple(tables), task, setup)
        raise UserError(f"in scene '{room.scene.name}' no script of {SHORTEST} to {LONGEST} actions was found")

    def left_out(self) -> dict[str, str]:
        """Why kinds of actions were not drawn, by kind."""
        why = {spec.name: "the bench has no parameters for it" for spec in actions() if spec.name not in DRAWS}
        return why | {kind: "no scene has what it takes" for kind in DRAWS if not self.counts[kind]}

    def _tables(self, room: Room) -> tuple[list[Parameters], State]:
        """[[action]] tables and where the first one begins; no tables where it goes on nowhere."""
        x, z = (float(value) for value in room.area.sample(1, self.rng)[0].round(3))
        start = state = State(
            (x, float(room.scene.ground_at(x, z)), z), round(float(self.rng.uniform(-math.pi, math.pi)), 3)
        )
        tables, count = list[Parameters](), int(self.rng.integers(SHORTEST, LONGEST + 1))
        while len(tables) < count:
            found = self._next(room, state, tables, last=len(tables) == count - 1)
            if found is None:
                return [], start
            table, act = found
            tables.append(table)
            state = act.then
        return tables, start

    def _next(
        self, room: Room, state: State, tables: Sequence[Parameters], last: bool
    ) -> tuple[Parameters, Act] | None:
        """An action, as planned; None where there is none."""
        counts = self.counts + Counter(table["do"] for table in tables)
        mixed = [str(kind) for kind in self.rng.permutation([spec.name for spec in actions() if spec.name in DRAWS])]
        stays = state.posture != "standing" and float(self.rng.random()) < STAYS
        for kind in sorted(mixed, key=lambda kind: (stays and get_action(kind).posture is not None, counts[kind])):
            if get_action(kind).posture not in (None, state.posture):
                continue
            if state.holds and kind not in WITH_HANDS_FULL:
                continue
            given = DRAWS[kind](room, state, self.rng)
            if given is None:
                continue
            table = {"do": kind, **given}
            try:
                act = Entry.of(len(tables) + 1, table).act(room.world, state)
            except UserError as error:
                self.rejected[reason(kind, error)] += 1
                continue
            if not last or (act.then.posture == "standing" and not act.then.holds):
                return table, act
        return None


def reason(kind: str, error: UserError) -> str:
    """What an error says, without numbers, names and hints, so that equal ones count together."""
    told = re.sub(r"^action \d+ \('[^']*'\):? ?", "", str(error)).partition(";")[0]
    told = re.sub(r"\[[^\]]*\]|\([-\d., ]+\)|'[^']*'|-?\d+(?:\.\d+)?", "…", told)
    return f"{kind}: {told}"


def asked(table: Mapping[str, Any]) -> tuple[str, ...] | None:
    """Kinds of the second classifier that show what an [[action]] table asks for; None where goals alone tell."""
    if table["do"] == "wave":
        return WAVES[table["hand"]]
    return SENTENCES[table["prompt"].replace(SITS, "")] if table["do"] == "act" else None
