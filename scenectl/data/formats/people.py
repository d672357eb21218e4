"""How large people are, and which way is up: what joints say where nobody stated unit or axis."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from scenes.errors import UserError, did_you_mean
from scenes.mesh.scale import TO_Y_UP, UNITS as LENGTHS
from scenes.motion.skeleton import HUMANML3D

UNITS = {**LENGTHS, "cmu": 0.0254 / 0.45}
"""Metres in a unit. "cmu" is the unit of CMU's Acclaim files and of the conversions that kept it (1/0.45 inch)."""

_LEG = (0.55, 1.2)
"""Metres from hip to ankle that a person may have, children included."""
_POSSIBLE = (0.2, 3.0)
"""Metres that a figure's legs may have where its unit is stated."""
_TYPICAL = 0.82


def leg_length(joints: Float[np.ndarray, "*b 22 3"]) -> float:
    """From hip to ankle along the left leg, the median over all poses, in the joints' unit."""
    chain = joints[..., HUMANML3D.indices(("left_hip", "left_knee", "left_ankle")), :]
    return float(np.median(np.linalg.norm(np.diff(chain, axis=-2), axis=-1).sum(axis=-1)))


def likely_unit(joints: Float[np.ndarray, "*b 22 3"]) -> str:
    """The unit in which legs are nearest to a person's; raises UserError where they are near to none."""
    leg = leg_length(joints)
    best = min(UNITS, key=lambda key: abs(math.log(max(leg, 1e-9) * UNITS[key] / _TYPICAL)))
    if not _LEG[0] <= leg * UNITS[best] <= _LEG[1]:
        raise UserError(f"legs of {leg:.4g} units fit no known unit; state one of {', '.join(UNITS)}")
    return best


def turned(joints: Float[np.ndarray, "*b 22 3"], unit: str, up: str) -> Float[np.ndarray, "*b 22 3"]:
    """Joints in metres, y up; raises UserError for an unknown unit or axis."""
    if unit not in UNITS:
        raise UserError(f"unknown unit '{unit}'{did_you_mean(unit, UNITS)}")
    if up not in TO_Y_UP:
        raise UserError(f"unknown up axis '{up}'{did_you_mean(up, TO_Y_UP)}")
    if UNITS[unit] == 1 and up == "y":
        return joints
    moved: np.ndarray = joints * UNITS[unit] @ TO_Y_UP[up].T
    return moved


def check_legs(joints: Float[np.ndarray, "*b 22 3"], unit: str) -> None:
    """Raise UserError for joints (m), read in a unit, of which nobody's legs are: it names the unit that fits."""
    if _POSSIBLE[0] <= (leg := leg_length(joints)) <= _POSSIBLE[1]:
        return
    units = leg / UNITS[unit]
    fitting = [word for word, metres in LENGTHS.items() if _LEG[0] <= units * metres <= _LEG[1]]
    none = "no unit makes them a person's; check the joints and their order"
    hint = f"state --unit {fitting[0]}" if fitting else none
    raise UserError(f"legs would be {leg:.3g} m long in unit '{unit}'; {hint}")


def doubted_legs(joints: Float[np.ndarray, "*b 22 3"], where: str) -> tuple[str, ...]:
    """A sentence where legs (m) are no person's, and nobody stated the unit."""
    if _LEG[0] <= (leg := leg_length(joints)) <= _LEG[1]:
        return ()
    fitting = [word for word, metres in LENGTHS.items() if _LEG[0] <= leg * metres <= _LEG[1]]
    state = f"state --unit {fitting[0] if fitting else 'cm'}, or --unit m if that is so"
    return (f"{where}: legs are {leg:.2f} m long as read, and a person's are {_LEG[0]:g} to {_LEG[1]:g} m; {state}",)


def doubted_axis(joints: Float[np.ndarray, "*b 22 3"], where: str) -> tuple[str, ...]:
    """A sentence where the head is not above the feet for most of a motion, and nobody stated the axis."""
    ankles = joints[..., HUMANML3D.indices(("left_ankle", "right_ankle")), :].mean(axis=-2)
    rise = np.median((joints[..., HUMANML3D.index("head"), :] - ankles).reshape(-1, 3), axis=0)
    axis = "xyz"[int(np.abs(rise).argmax())]
    if axis == "y" and rise[1] > 0:
        return ()
    if axis == "y":
        return (f"{where}: the head is below the feet for most of it; is -y up?",)
    told = f"{where}: the head is not above the feet along y for most of it, but along {axis}"
    return (f"{told}; state --up {axis}, or --up y if that is so",)
