"""The body itself: bones of one length, and joints that bend as far as they go."""

from __future__ import annotations

import numpy as np

from objectives import Context
from objectives.library.natural import joint_limits
from scenectl.measures.believability.checks.check import Check, Found
from scenectl.measures.believability.evidence import Evidence, averages
from scenectl.measures.believability.words import bone_name, centimetres
from scenes.motion.bones import bone_lengths, rest_lengths


def bones(evidence: Evidence) -> Found | None:
    """How far (m) a bone is off its length: the skeleton's, scaled to the size of the body.

    The size is the median ratio over bones and frames, so that tall and short people are judged by their proportions.
    """
    given = evidence.given
    if not given.frames:
        return None
    lengths = bone_lengths(given).detach().cpu().double().numpy()
    rest = rest_lengths(given).detach().cpu().double().numpy()
    off = lengths - rest * np.median(np.median(lengths, axis=0) / rest)
    frame, bone = np.unravel_index(int(np.abs(off).argmax()), off.shape)
    value, at = float(off[frame, bone]), float(given.times[frame])
    part = bone_name(given.skeleton.names[given.skeleton.bones[bone][1]])
    word = "longer" if value > 0 else "shorter"
    return Found(abs(value), f"{part} {centimetres(abs(value))} {word} than it should be at {at:.2f} s", at, part)


def joints(evidence: Evidence) -> Found | None:
    """How far (degrees) a knee or an elbow is bent beyond what joints do, averaged over 0.15 s.

    The limits of `objectives.library.natural.joint_limits`: the American Academy of Orthopaedic Surgeons', widened.
    """
    if evidence.frames < 3:
        return None
    found = joint_limits(evidence.motion, Context(evidence.scorer.scene, evidence.scorer.body))
    excess = averages(np.degrees(found.residual.detach().cpu().double().numpy()), 0.15)
    first, joint = np.unravel_index(int(excess.argmax()), excess.shape)
    value, at = float(excess[first, joint]), float(evidence.times[first + 1])
    part = str(found.labels[int(joint)]).replace("_", " ")
    return Found(value, f"{part} bent {value:.0f} degrees further than it goes at {at:.2f} s", at, part)


CHECKS = (
    Check("bones", "m", bones, 0.06, "issue 21: bones more than 6 cm off their length", explains=4),
    Check("joints", "degrees", joints, share=0.997),
)
