"""How fast: speeds, accelerations and turns, and places that are jumped to."""

from __future__ import annotations

import numpy as np

from scenectl.measures.believability.checks.check import Check, Found
from scenectl.measures.believability.evidence import RATE, Evidence, averages
from scenectl.measures.believability.words import joint_name


def speed(evidence: Evidence) -> Found | None:
    """Speed (m/s) of the pelvis over the ground, averaged over half a second; the fastest."""
    if evidence.frames < 3:
        return None
    means = np.linalg.norm(averages(evidence.velocities[:, 0, ::2], 0.5), axis=-1)
    return _told(evidence, means, 0.5, "moves at {:.1f} m/s", None)


def joint_speed(evidence: Evidence) -> Found | None:
    """Speed (m/s) of a joint as seen from the pelvis, averaged over 0.15 s; the fastest joint at its fastest."""
    if evidence.frames < 4:
        return None
    relative = np.linalg.norm(evidence.velocities - evidence.velocities[:, :1], axis=-1)
    means = averages(relative, 0.15)
    joint = int(means.max(axis=0).argmax())
    return _told(evidence, means[:, joint], 0.15, "moves at {:.1f} m/s beside the pelvis", joint)


def acceleration(evidence: Evidence) -> Found | None:
    """Acceleration (m/s^2) of a joint, averaged over 0.25 s; the worst joint at its worst."""
    if evidence.frames < 7:
        return None
    sizes = np.linalg.norm(np.diff(evidence.velocities, axis=0), axis=-1) * RATE
    means = averages(sizes, 0.25)
    joint = int(means.max(axis=0).argmax())
    return _told(evidence, means[:, joint], 0.25, "accelerates by {:.0f} m/s^2", joint)


def turning(evidence: Evidence) -> Found | None:
    """How fast (degrees/s) hips and shoulders turn about the vertical, averaged over 0.3 s, while they are upright."""
    if evidence.frames < 7:
        return None
    across = sum(evidence.joint(f"left_{part}") - evidence.joint(f"right_{part}") for part in ("hip", "shoulder"))
    level = np.linalg.norm(across[:, ::2], axis=1) > 0.5 * np.linalg.norm(across, axis=1)
    heading = np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))
    rates = np.diff(heading) * RATE * (level[1:] & level[:-1])
    return _told(evidence, np.degrees(np.abs(averages(rates, 0.3))), 0.3, "turns by {:.0f} degrees/s", None)


def jump(evidence: Evidence) -> Found | None:
    """How much further (m) the pelvis goes in a step between two frames than in those before and after on average."""
    if evidence.frames < 4:
        return None
    steps = np.diff(evidence.joints[:, 0], axis=0)
    around = np.concatenate([steps[1:2], (steps[2:] + steps[:-2]) / 2, steps[-2:-1]])
    extra = np.linalg.norm(steps - around, axis=1)
    frame = int(extra.argmax())
    at = float(evidence.times[frame])
    return Found(float(extra[frame]), f"jumps by {extra[frame]:.2f} m within a frame at {at:.2f} s", at)


def _told(evidence: Evidence, means: np.ndarray, window: float, words: str, joint: int | None) -> Found:
    first = int(means.argmax())
    value, at = float(means[first]), float(evidence.times[min(first + round(window * RATE / 2), evidence.frames - 1)])
    part = None if joint is None else joint_name(evidence.motion.skeleton, joint)
    return Found(value, f"{part or 'the body'} {words.format(value)} at {at:.2f} s", at, part)


CHECKS = (
    Check("speed", "m/s", speed, share=0.998, grows=True),
    Check("joint_speed", "m/s", joint_speed, share=0.996, grows=True),
    Check("acceleration", "m/s^2", acceleration, share=0.997, grows=True),
    Check("turning", "degrees/s", turning, share=0.997),
    Check("jump", "m", jump, share=0.999, explains=2, plainly=3.0, grows=True),
)
