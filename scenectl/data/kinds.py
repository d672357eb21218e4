"""Kinds of motion: what a clip shows, in words few enough to balance training by and to score a generator with."""

from __future__ import annotations

import re

from scenectl.data.corpus import Clip

REST = "other"
"""Kind of clips that no group claims."""

_GROUPS = {
    "get up": r"get.?up|lie|fall|death|slip",
    "acrobatics": r"cartwheel|flip|hand ?stand|hand ?spring|acrobatic|roll|swing|helicopter|jump ?twist",
    "ball": r"basketball|soccer|throw",
    "fight": r"box|punch|kick|sword|empi|gedan|heian|mawashi|oiduki|syutouuke|yokogeri",
    "dance": r"dance|ymca",
    "climb": r"climb|playground",
    "squat": r"squat1",
    "exercise": r"jumping jacks|elbow|rotate ?arms|range of motion|motorcycle",
    "hop": r"hop|jump|leap",
    "sit and kneel": r"^sit|kneel",
    "mimicry": r"human subject|nursery|alaskan|zombie|crawl",
    "reach": r"grab|deposit|reach|scoop|drink|wash|mop|push|interact",
    "gesture": r"traffic|laugh|talk|idle|balance",
    "sneak": r"sneak|stealthy|crouch|low_walk",
    "run": r"run|jog",
    "turn": r"turn|veer|\d\d|left|(?<!st)right|spiral|navigate|figure eight|spin",
    "walk": r"walk|stride",
}
"""Kinds of clips other than Bandai's, by what their labels say; the first that matches counts."""


COMPOSED = "composed"
"""Kind of clips that show several acts, put together of others."""
_OWN = (
    "idle", "start", "stop", "turn in place", "sit down", "sit", "stand up", "climb", "pick up", "put down", "carry",
    "lean", "crouch", "duck", "sidestep", COMPOSED,
)  # fmt: skip
EDITS = {name: name for name in _OWN} | {"reach": "reach while walking", "reach standing": "reach"}
"""What ends the labels of clips that are found in, edited from or composed of recorded ones, and the kinds that these
are: such clips are many, and would outweigh the few recordings in a kind with them."""

_RECORDED = re.compile(r"[^~]*(?:~(?:m|b[+-][\d.]+|s[\d.]+|repeat))*")
"""Ids of recorded clips and of copies that show the same; a source's own label may end in ", stand up" too."""


def kind(source: str, label: str) -> str:
    """Kind of a clip: Bandai's content ("bandai: walk-turn-left"), elsewhere a group ("walk", "dance", ...)."""
    return EDITS.get(label.rpartition(", ")[2]) or _recorded_kind(source, label)


def _recorded_kind(source: str, label: str) -> str:
    if source == "bandai":
        return f"bandai: {label}"
    words = label.lower()
    return next((name for name, pattern in _GROUPS.items() if re.search(pattern, words)), REST)


def kind_of(clip: Clip) -> str:
    """Kind of a clip by its source and label."""
    return (_recorded_kind if is_recorded(clip.id) else kind)(clip.source, clip.label)


def is_recorded(name: str) -> bool:
    """Whether a clip of this id is a recording, or a copy that shows the same: not found, edited or composed."""
    return _RECORDED.fullmatch(name) is not None
