"""Clips that show one act each: what the second classifier learns from, and what it is tried on."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from scenectl.data.augment import Augmentation
from scenectl.data.clips import ClipSet, Told, prepare
from scenectl.data.kinds import COMPOSED
from scenectl.data.sources import is_humanml3d
from scenes.errors import UserError

COPIES = Augmentation(bend=0)
"""Everything that is found, edited and composed; bent and retimed copies show nothing new."""
PIECES = Augmentation(bend=0, mirror=False, repeat=0, composed=0.2)
HELD_OUT = ("test", "held out")
"""Splits that no classifier and no generator learns from."""
_FOUND = re.compile(r"[^+]*~[a-z-]+\d+")
"""Ids of pieces that were found in recordings, which end in what they show and their first frame; an edit has none, and
a "+" stands between what is put together."""
SURE = 0.8
"""Share of the clips of which a sentence is said that must be of one kind for the sentence to tell the kind."""


def single_acts(data: ClipSet) -> ClipSet:
    """Clips that show what their kind says, and the single acts of composed ones, each with its kind.

    What kind an act is, its sentences tell: that of the other clips of which they are said. Acts whose sentences are
    said of several kinds are left out.
    """
    said = _said(data)
    cuts: list[tuple[int, Told, str]] = []
    for i, (whole, *parts) in enumerate(data.told):
        if data.groups[i] != COMPOSED:
            cuts.append((i, whole, data.groups[i]))
        else:
            known = [(part, _kind(part.captions, said)) for part in parts if part.acts == 1]
            cuts += [(i, part, kind) for part, kind in known if kind is not None]
    return _cut(data, cuts)


def held_out_pieces(folder: Path, cache: Path) -> ClipSet:
    """Pieces of held-out recordings that show one act each, whole recordings left out.

    Kinds that are found in recordings are those pieces; kinds that no recording shows are edits of test clips. The ids
    tell which (`is_edit`).

    Raises:
        UserError: it is no motion collection, or holds no captioned clip that is held out.
    """
    data = _held_out(folder, cache)
    made = [i for i, name in enumerate(data.ids) if "~" in name and data.groups[i] != COMPOSED]
    real = {data.groups[i] for i in made if not is_edit(data.ids[i])}
    return _whole(data, [i for i in made if not is_edit(data.ids[i]) or data.groups[i] not in real])


def composed_clips(folder: Path, cache: Path) -> ClipSet | None:
    """What is put together of held-out recordings; None where nothing is. Raises UserError as `held_out_pieces` does.

    A recording that shows several acts by itself has no seams, and is left out.
    """
    data = _held_out(folder, cache)
    several = [i for i, kind in enumerate(data.groups) if kind == COMPOSED and is_edit(data.ids[i])]
    return _whole(data, several) if several else None


def _held_out(folder: Path, cache: Path) -> ClipSet:
    if is_humanml3d(folder):
        raise UserError(f"folder '{folder}' is HumanML3D, which tells no kinds of motion; name a motion collection")
    return prepare(folder, HELD_OUT, PIECES, cache, 0)


def is_edit(name: str) -> bool:
    """Whether a clip of that id is an edit, and not a recording or a piece of one."""
    return "~" in name and _FOUND.fullmatch(name) is None


def _said(data: ClipSet) -> dict[str, Counter[str]]:
    """Of how many clips that are not composed each sentence is said, by their kind."""
    said: dict[str, Counter[str]] = {}
    for stretches, kind in zip(data.told, data.groups, strict=True):
        for caption in stretches[0].captions if kind != COMPOSED else ():
            said.setdefault(caption, Counter())[kind] += 1
    return said


def _kind(captions: Sequence[str], said: dict[str, Counter[str]]) -> str | None:
    counts: Counter[str] = Counter()
    for caption in captions:
        counts += said.get(caption, Counter())
    ((kind, most),) = counts.most_common(1) or [("", 0)]
    return kind if most and most >= SURE * counts.total() else None


def _whole(data: ClipSet, clips: Sequence[int]) -> ClipSet:
    """Some of the clips, with all that is told of them."""
    some = _cut(data, [(i, data.told[i][0], data.groups[i]) for i in clips])
    return replace(some, told=[data.told[i] for i in clips])


def _cut(data: ClipSet, cuts: Sequence[tuple[int, Told, str]]) -> ClipSet:
    """Stretches of clips as clips, each with its kind."""
    rows = [
        data.features[int(data.starts[i]) :][told.begin : min(told.end, int(data.lengths[i]))] for i, told, _ in cuts
    ]
    return ClipSet.of(
        rows,
        told=[[Told(0, len(row), told.captions)] for row, (_, told, _) in zip(rows, cuts, strict=True)],
        groups=[kind for *_, kind in cuts],
        sources=[data.sources[i] for i, *_ in cuts],
        ids=[data.ids[i] for i, *_ in cuts],
        licences=[data.licences[i] for i, *_ in cuts],
        commercial=[data.commercial[i] for i, *_ in cuts],
    )
