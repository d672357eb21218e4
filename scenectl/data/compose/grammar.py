"""Which act may follow which: a small table of acts and of the states of a person before and after them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from scenectl.data.corpus import Clip
from scenectl.data.kinds import kind_of

STANDING, SEATED, LADEN = "standing", "seated", "hands full"


@dataclass(frozen=True)
class ActKind:
    """A kind of act.

    Attributes:
        name: as a composed clip's label says it.
        first, last: names of what it begins and ends with, where clips of it show more than the act itself.
        before, after: states of the person.
        steady: any stretch of it is one too; others are shown whole.
        weight: how often it is put before or after another, relative to other kinds.
    """

    name: str
    before: str = STANDING
    after: str = STANDING
    steady: bool = False
    weight: float = 1.0
    first: str = ""
    last: str = ""


MADE = {
    kind.name: kind
    for kind in (
        ActKind("idle", steady=True, weight=2.0),
        ActKind("start", weight=2.0, first="idle", last="walk"),
        ActKind("stop", weight=5.0, first="walk", last="idle"),
        ActKind("turn in place", weight=2.0),
        ActKind("sit down", STANDING, SEATED, weight=2.0),
        ActKind("sit", SEATED, SEATED, steady=True, weight=3.0),
        ActKind("stand up", SEATED, STANDING, weight=3.0),
        ActKind("climb"),
        ActKind("pick up", STANDING, LADEN, last="carry"),
        ActKind("carry", LADEN, LADEN, steady=True, weight=3.0),
        ActKind("put down", LADEN, STANDING, first="carry"),
        ActKind("lean"),
        ActKind("crouch", steady=True),
        ActKind("duck", first="walk", last="walk"),
        ActKind("sidestep", steady=True),
        ActKind("reach", first="walk", last="walk"),
    )
}
"""Of found and edited clips, by how their labels end."""

RECORDED = (
    (r"bandai: walk-turn.*|turn", ActKind("turn", weight=4.0)),
    (r"bandai: walk-(back|left|right)", ActKind("walk aside", steady=True)),
    (r"(bandai: )?walk", ActKind("walk", steady=True, weight=24.0)),
    (r"(bandai: )?run|bandai: dash", ActKind("run", steady=True)),
    (r"sneak", ActKind("sneak", steady=True)),
    (r"bandai: (wave.*|bye.*)", ActKind("wave")),
    (r"bandai: (raise.*|respond)", ActKind("raise a hand")),
    (r"bandai: (call|guide)", ActKind("beckon")),
    (r"bandai: bow", ActKind("bow")),
    (r"bandai: (kick|punch|slash)", ActKind("strike", steady=True)),
    (r"fight", ActKind("fight")),
    (r"reach", ActKind("reach for")),
    (r"squat", ActKind("squat")),
    (r"exercise", ActKind("exercise")),
    (r"hop", ActKind("hop")),
    (r"ball", ActKind("throw")),
)
"""Of recorded clips, by their kind. Those that lie, roll or seat somebody are found before they are composed."""

LONGEST = 160
"""Frames of an act that is shown whole, at most: something has to fit beside it."""
_ONE = re.compile(r"\b(and|then|times|around|(two|three|four) steps)\b|[,;0-9]")
"""What says that a sentence tells of more than one thing, or of how often: it does not hold of a part."""
_BARE = re.compile(r"(?<!,)(?<! and) then ")
"""A "then" that has no place between others: "walks then makes a left turn"."""
_HELD = re.compile(r"\b(?:carr\w+|hold\w*|picks up|takes|puts|sets|places|lays) (something|an? \w+)")
_SAYS = re.compile(r"^(a person|someone|the person|a man|a woman|a human) (\w+ly )?(?!is |does )\w+s\b")
"""A sentence with a subject and a verb in the present, which can be joined to others."""


def act_of(clip: Clip) -> ActKind | None:
    """Kind of act that a clip shows; None where it has no part in sequences."""
    end = clip.label.rpartition(", ")[2]
    made = MADE.get(end) if "~" in clip.id else None
    if made is None:
        name = "" if end == "composed" else kind_of(clip)
        made = next((act for pattern, act in RECORDED if re.fullmatch(pattern, name)), None)
    if made is None or (not made.steady and clip.frames > LONGEST):
        return None
    if not all(sentences(act.captions, made) for act in clip.acts) or not sentences(clip.captions, made):
        return None
    full = f"{LADEN}: {_held(clip)}"  # what is picked up is what is carried and put down
    before, after = (full if state == LADEN else state for state in (made.before, made.after))
    if clip.acts:
        return replace(made, before=before, after=after)
    return replace(made, before=before, after=after, first="", last="")


def _held(clip: Clip) -> str:
    """What the person holds, in the words of the captions."""
    return next((found[1] for text in clip.captions if (found := _HELD.search(text))), "something")


def sentences(captions: Sequence[str], act: ActKind) -> tuple[str, ...]:
    """Captions that hold of what a sequence shows of a clip, and that a sentence can join to others."""
    fit = (text for text in captions if _SAYS.match(text) and not _BARE.search(text))
    return tuple(text for text in fit if not (act.steady and _ONE.search(text)))


def may_follow(first: ActKind, second: ActKind) -> bool:
    """Whether a person who has done the first can do the second next."""
    return first.after == second.before and (first.last or first.name) != (second.first or second.name)
