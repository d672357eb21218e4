"""Standing still: more still than people are, and where the sentence moves."""

from __future__ import annotations

import re

import numpy as np

from scenectl.generators.prompts import Prompts
from scenectl.measures.believability.checks.check import Check, Found
from scenectl.measures.believability.evidence import RATE, Evidence, averages, longest_run
from scenectl.measures.believability.words import span

STILL = 0.03
"""Speed (m/s) below which a joint does not move: people sway, and captures have millimetres of noise."""

_TRAVELS = re.compile(
    r"\b(walk|run|jog|sprint|march|stroll|stride|sneak|tiptoe|wander|pace|dash|hurr(?:y|ie)|limp|stagger|creep|travel)"
    r"(?:s|es|ed|ing|ning|ging)?\b",
    re.IGNORECASE,
)
_STAYS = re.compile(r"\b(in place|on the spot|treadmill|without moving|stands? still)\b", re.IGNORECASE)


def frozen(evidence: Evidence) -> Found | None:
    """The longest time (s) in which no joint moves faster than `STILL`."""
    if evidence.frames < 3:
        return None
    speeds = np.linalg.norm(evidence.velocities, axis=-1).max(axis=1)
    first, count = longest_run(speeds < STILL)
    return Found(
        count / RATE, f"nothing moves {span(evidence.times, first, first + count)}", float(evidence.times[first])
    )


def standing(evidence: Evidence) -> Found | None:
    """Speed (m/s) of the pelvis over the fastest second of a sentence with a verb of going; the least of several."""
    found = []
    for prompt in Prompts.of(evidence.prompt).spans() if evidence.prompt else ():
        first, last = np.searchsorted(evidence.times, (prompt.begin or -np.inf, prompt.end or np.inf))
        if last - first < RATE or not travels(prompt.text):
            continue
        means = np.linalg.norm(averages(evidence.velocities[first:last, 0, ::2], 1.0), axis=-1)
        found.append(float(means.max()))
    if not found:
        return None
    value = min(found)
    return Found(value, f"stays where it is, at {value:.2f} m/s at the most, where the sentence moves")


def travels(prompt: str) -> bool:
    """Whether a sentence says that a person gets somewhere on foot."""
    return _TRAVELS.search(prompt) is not None and _STAYS.search(prompt) is None


CHECKS = (
    Check("frozen", "s", frozen, share=0.998, explains=3),
    Check("standing_still", "m/s", standing, share=0.998, least=True, grows=True),
)
