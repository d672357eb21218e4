"""The judge: every check on one motion in one scene."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from objectives import Objective
from scenectl.generators.prompts import Prompts
from scenectl.measures.believability.checks import CHECKS
from scenectl.measures.believability.checks.check import Check, Found
from scenectl.measures.believability.checks.contact import exempted
from scenectl.measures.believability.checks.support import support
from scenectl.measures.believability.evidence import RATE, Evidence, Exemption, Support
from scenectl.measures.believability.limits import LIMITS
from scenectl.measures.believability.verdict import Finding, Verdict
from scenectl.measures.metrics import Depths, Scorer
from scenes.motion.motion import Motion

Series = dict[str, list[float | None] | list[str] | dict[str, list[float | None]]]
"""Numbers for each frame by name, those about parts of the body by part; None where there is none."""


@dataclass(frozen=True, eq=False)
class Judge:
    """Says whether a person would move like that.

    Attributes:
        scorer: of the scene that the motion is in, with the body.
        prompt: the sentence that the motion shall show, or several; standing still is found fault with where it moves.
        exemptions: what the task lets touch the scene.
        supports: what of the body the task rests on something.
    """

    scorer: Scorer
    prompt: Prompts | str = ""
    exemptions: tuple[Exemption, ...] = ()
    supports: tuple[Support, ...] = ()

    @classmethod
    def of(cls, scorer: Scorer, prompt: Prompts | str, objective: Objective) -> Judge:
        """The judge of a task, whose goals say what may touch the scene and what of the body rests on something."""
        exempt = tuple(one for term in objective.counted for one in term.exemptions)
        rests = tuple(term.support for term in objective.counted if term.support is not None)
        return cls(scorer, prompt, exempt, rests)

    def verdict(self, motion: Motion, depths: Depths | None = None) -> Verdict:
        """The verdict on one motion, ``[T, J, 3]`` in the scene's frame; `depths` are the scorer's where known.

        The worst finding comes first: those that explain others before these, then by how many times the limit.
        """
        evidence = Evidence.of(motion, self.scorer, self.prompt, self.exemptions, self.supports, depths)
        looked, size = [(check, check.look(evidence)) for check in CHECKS], evidence.size
        found = sorted(
            ((check, one) for check, one in looked if one is not None and _off(check, one.value, size) > 1.0),
            key=lambda pair: _weight(pair[0], _off(pair[0], pair[1].value, size)),
            reverse=True,
        )
        figures = {check.key: None if one is None else one.value for check, one in looked}
        return Verdict(tuple(_finding(*pair, size) for pair in found), figures, exempted(evidence))

    def series(self, motion: Motion, depths: Depths | None = None) -> Series:
        """Per frame of one motion, ``[T, J, 3]``: "clearance_m" by part, "speed_m_per_s", "support".

        Clearance is to obstacles, and None where there are none; speed is the pelvis's over the ground; support is
        "both", "left_foot", "right_foot", "other", "flight" or "none". Frames that are padding have None and "none".
        """
        depths = self.scorer.depths(motion) if depths is None else depths
        names = self.scorer.parts
        clearance = {
            part: _numbers(depths.rooms[:, [i for i, name in enumerate(names) if name == part]].min(axis=1))
            for part in dict.fromkeys(names)
        }
        evidence = Evidence.of(motion, self.scorer, supports=self.supports, depths=depths)
        real = np.flatnonzero(motion.valid.cpu().numpy())
        speed, carried = np.full(motion.frames, np.nan), np.full(motion.frames, "none", dtype=object)
        if len(real):
            nearest = np.rint((real - real[0]) * RATE / motion.fps).astype(int).clip(0, evidence.frames - 1)
            carried[real] = np.array(support(evidence, SUPPORTED))[nearest]
        if len(real) > 1:
            pelvis = evidence.given.joint("pelvis").detach().cpu().double().numpy()[:, ::2]
            speed[real] = np.linalg.norm(np.gradient(pelvis, axis=0), axis=1) * motion.fps
        return {"clearance_m": clearance, "speed_m_per_s": _numbers(speed), "support": [str(w) for w in carried]}


SUPPORTED = 0.05
"""Height (m) up to which a part of the body is taken for in touch: what recorded steps on level ground rise to
(`foot_contact` has the same)."""


def limit_of(check: Check, size: float = 1.0) -> float | None:
    """What people of a size (of legs, an adult's being 1) stay within, in the check's unit; None if not measured."""
    limit = LIMITS.values.get(check.name) if check.limit is None else check.limit
    return limit * size if limit is not None and check.grows else limit


def _off(check: Check, value: float, size: float) -> float:
    """How many times its limit a value is; up to 1 is within."""
    limit = limit_of(check, size)
    if limit is None:
        return 0.0
    return limit / max(value, 1e-6) if check.least else value / limit


def _weight(check: Check, off: float) -> tuple[int, float]:
    """What findings are sorted by: whether they explain others, then how far off they are."""
    return (check.explains if off >= check.plainly else 0), off


def _finding(check: Check, found: Found, size: float) -> Finding:
    limit = limit_of(check, size)
    assert limit is not None
    return Finding(check.name, found.value, limit, check.unit, found.sentence, found.at_s, found.part)


def _numbers(values: np.ndarray) -> list[float | None]:
    """To the millimetre, None for what is not finite."""
    return [round(float(value), 3) if math.isfinite(value) else None for value in values]
