"""New captioned clips found in recorded ones: rests, stops, starts, turns in place, sitting, climbing, handling.

Detectors look at motions, and at labels and captions only where the motion cannot tell, so that other collections are
searched as well as the shared one.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from scenectl.data import held_out as takes
from scenectl.data.corpus import Clip, load_motions
from scenectl.data.found.climbing import climbs
from scenectl.data.found.handling import handlings
from scenectl.data.found.pieces import SHORTEST
from scenectl.data.found.sitting import sits
from scenectl.data.found.standing import idles, stops_and_starts, turns_in_place

DETECTORS = (idles, stops_and_starts, turns_in_place, sits, climbs, handlings)


def found(clips: Sequence[Clip]) -> list[Clip]:
    """Pieces of recorded clips, each a clip of its own that says what it shows; the same ones every time."""
    long = [clip for clip in clips if clip.frames >= SHORTEST]
    return [made for clip in long for detector in DETECTORS for made in detector(clip)]


def held_out(folder: str | Path) -> list[Clip]:
    """Pieces of the takes set aside and of the collection's own test clips, to test with and never to train on.

    Raises:
        UserError: the folder is no motion collection.
    """
    return found(load_motions(folder, (takes.SPLIT, "test")))
