"""The judge: every check on one motion in one scene."""

from __future__ import annotations

from dataclasses import dataclass

from scenectl.measures.believability.verdict import Finding, Verdict
from scenectl.measures.metrics import Depths, Scorer
from scenes.motion.motion import Motion

Exemption = tuple[tuple[str, ...], tuple[tuple[float, float], ...] | None]
"""Joints (none: the whole body) that may touch the scene, and the windows (s) in which they may (None: always)."""

Series = dict[str, list[float | None] | list[str] | dict[str, list[float | None]]]


@dataclass(frozen=True, eq=False)
class Judge:
    """Says whether a person would move like that.

    Attributes:
        scorer: of the scene that the motion is in, with the body.
        prompt: the sentence that the motion shall show; standing still is found fault with where it moves.
        exemptions: what the task lets touch the scene.
    """

    scorer: Scorer
    prompt: str = ""
    exemptions: tuple[Exemption, ...] = ()

    def verdict(self, motion: Motion, depths: Depths | None = None) -> Verdict:
        """The verdict on one motion, ``[T, J, 3]`` in the scene's frame; `depths` where the scorer was asked before."""
        depths = self.scorer.depths(motion) if depths is None else depths
        deepest = float(depths.obstacles.max())
        if deepest <= 0.01:
            return Verdict((), {"penetration_m": deepest})
        frame = int(depths.obstacles.argmax())
        part, at = self.scorer.part(int(depths.part[frame])), float(motion.times[frame])
        told = f"{part} {100 * deepest:.0f} cm deep in an obstacle at {at:.2f} s"
        return Verdict((Finding("penetration", deepest, 0.01, "m", told, at, part),), {"penetration_m": deepest})

    def series(self, motion: Motion, depths: Depths | None = None) -> Series:
        """Per frame of one motion, ``[T, J, 3]``: "clearance_m" by part, "speed_m_per_s", "support"."""
        return {}
