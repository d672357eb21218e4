"""Names and hierarchies of skeletons that tools expect: a preset says which joints there are, and their names."""

from __future__ import annotations

from scenectl.export.animation import Animation
from scenes.errors import UserError, did_you_mean

PRESETS = ("humanml", "mixamo", "unreal", "unity", "vrm", "soma")


def named(animation: Animation, preset: str) -> Animation:
    """The same motion on the skeleton of a preset; our 22 joints stand where they did, at `Animation.ours`.

    Raises:
        UserError: an unknown preset.
    """
    if preset not in PRESETS:
        raise UserError(f"unknown names '{preset}'{did_you_mean(preset, PRESETS)}")
    if preset == "humanml":
        return animation
    raise UserError(f"names '{preset}' are not there yet")
