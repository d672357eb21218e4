"""The body itself: bones of one length, and joints that bend as far as they go."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from objectives import Context
from objectives.library.natural import joint_limits
from scenectl.measures.believability.checks.check import Check, Found
from scenectl.measures.believability.evidence import Evidence, averages
from scenectl.measures.believability.words import bone_name, centimetres
from scenes.motion.bones import bone_lengths, rest_lengths


def bones(evidence: Evidence) -> Found | None:
    """How far (m) a bone is off its own median length, whatever the proportions of the body."""
    if not evidence.given.frames:
        return None
    lengths = bone_lengths(evidence.given).detach().cpu().double().numpy()
    return _furthest(evidence, lengths - np.median(lengths, axis=0), "than at other times")


def proportions(evidence: Evidence) -> Found | None:
    """How far (m) a bone's median length is off the skeleton's, scaled to the size of the body.

    The size is the median ratio over bones, so that tall and short people are judged alike.
    """
    if not evidence.given.frames:
        return None
    lengths = np.median(bone_lengths(evidence.given).detach().cpu().double().numpy(), axis=0, keepdims=True)
    rest = rest_lengths(evidence.given).detach().cpu().double().numpy()
    return _furthest(evidence, lengths - rest * np.median(lengths / rest), "than it should be")


def _furthest(evidence: Evidence, off: Float[np.ndarray, "T B"], than: str) -> Found:
    """The bone that is longer or shorter (m) by the most, in whichever frame."""
    given = evidence.given
    frame, bone = np.unravel_index(int(np.abs(off).argmax()), off.shape)
    value, at = float(off[frame, bone]), float(given.times[frame])
    part = bone_name(given.skeleton.names[given.skeleton.bones[bone][1]])
    word = "longer" if value > 0 else "shorter"
    when = f" at {at:.2f} s" if len(off) > 1 else ""
    return Found(abs(value), f"{part} {_size(abs(value))} {word} {than}{when}", at if when else None, part)


def _size(metres: float) -> str:
    return centimetres(metres) if metres >= 0.01 else f"{1000 * metres:.0f} mm"


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
    Check("bones", "m", bones, 0.001, "ten times what is left of rigid bones in what scenectl makes", explains=4),
    Check("proportions", "m", proportions, 0.06, "issue 21: bones more than 6 cm off their length", explains=4),
    Check("joints", "degrees", joints, share=0.997),
)
