"""Who sits down, then sits: acts of pieces that show more of sitting than getting there."""

from __future__ import annotations

from dataclasses import replace

import torch

from scenectl.data.corpus import Act, Clip

SEATED = ("a person sits.", "someone stays seated.", "the person remains sitting.")
LEVEL = 0.15
"""Share of the pelvis's way between seat and stand within which a person counts as seated."""
LEAST = 16
"""Frames of sitting that are told of."""


def settled(clip: Clip) -> Clip:
    """The clip with acts for what is on the way and what is seated, where it sits down or stands up; else as it is.

    A window of the seated part alone would else be told that somebody sits down in it.
    """
    name = clip.label.rpartition(", ")[2]
    if clip.acts or name not in ("sit down", "stand up"):
        return clip
    height = clip.joints[:, 0, 1]
    on_the_way = torch.nonzero(height - height.min() > LEVEL * (height.max() - height.min())).flatten()
    if not len(on_the_way):
        return clip
    if name == "sit down":
        edge = int(on_the_way[-1]) + 1
        acts = Act(0, edge, clip.captions), Act(edge, clip.frames, SEATED)
        rest = clip.frames - edge
    else:
        edge = rest = int(on_the_way[0])
        acts = Act(0, edge, SEATED), Act(edge, clip.frames, clip.captions)
    return replace(clip, acts=acts) if rest >= LEAST else clip
