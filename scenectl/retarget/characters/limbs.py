"""Legs of two bones in closed form, all frames at once: hips stay, ankles go where they shall, bones stay as long."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import maximum_filter1d, uniform_filter1d

BENT = 0.01
"""Share of a leg by which a knee lies before the line from hip to ankle at least, where it says itself to which side it
bends; the straighter, the more the hinge of its joint says it. That is a bend of 2 degrees: an adult's knee is 8 mm off
the line."""
STRETCH = 0.998
"""Share of its length to which a leg is stretched by a foot that is held: knees bend by 7 degrees there. A millimetre
of a leg of 0.8 m then bends the knee by 2 degrees, and by 6 where it is straight, which shows as a snap."""


def bent(
    hip: Float[np.ndarray, "T 3"],
    knee: Float[np.ndarray, "T 3"],
    ankle: Float[np.ndarray, "T 3"],
    hinge: Float[np.ndarray, "T 3"],
    target: Float[np.ndarray, "T 3"],
) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3 3"]]:
    """World rotations of thigh and shin by which the ankle comes to a target, or as near to it as it reaches.

    The knee stays in the half plane in which it is, seen along the leg, and comes to lie before it where it did not.
    What is in place already turns by nothing.

    Args:
        hip, knee, ankle: where they are (m).
        hinge: unit directions about which knees bend backward.
        target: where the ankles shall be (m).
    """
    upper, lower = knee - hip, ankle - knee
    thigh, shin = np.linalg.norm(upper, axis=-1), np.linalg.norm(lower, axis=-1)
    before, _ = _unit(ankle - hip)
    after, reach = _unit(target - hip)
    reach = np.clip(reach, np.abs(thigh - shin) + 1e-9, thigh + shin)
    front = np.cross(before, hinge)
    front = _unit(front)[0]
    aside = np.cross(before, front)
    least, out = BENT * (thigh + shin), upper - _dot(upper, before)[:, None] * before
    ahead, beside = _dot(out, front), _dot(out, aside)
    forward = (ahead + np.hypot(ahead, least)) / 2
    beside = beside * forward / (np.abs(ahead) + least)
    pole = forward[:, None] * front + beside[:, None] * aside
    pole = np.einsum("tij,tj->ti", between(before, after), pole)
    pole = _unit(pole - _dot(pole, after)[:, None] * after)[0]
    along = (reach**2 + thigh**2 - shin**2) / (2 * reach)
    up = np.sqrt(np.maximum(thigh**2 - along**2, 0.0))
    bone = along[:, None] * after + up[:, None] * pole
    return between(upper, bone), between(lower, reach[:, None] * after - bone)


def lowered(
    hips: Float[np.ndarray, "n T 3"],
    targets: Float[np.ndarray, "n T 3"],
    reach: Float[np.ndarray, "n T"],
    window: int,
) -> Float[np.ndarray, " T"]:
    """By how much (m) hips go down so that every leg reaches its target, smooth over so many frames to either side.

    Never less than is needed; where a target is further away on the ground than a leg is long, nothing helps and none
    is lowered for it.
    """
    gap = targets - hips
    height = reach**2 - gap[..., 0] ** 2 - gap[..., 2] ** 2
    need = np.where(height > 0, -gap[..., 1] - np.sqrt(np.maximum(height, 0.0)), 0.0).max(axis=0).clip(0.0)
    size = 2 * window + 1
    lower: np.ndarray = uniform_filter1d(maximum_filter1d(need, size, mode="nearest"), size, mode="nearest")
    return lower


def eased(by: Float[np.ndarray, "T 3"], held: Bool[np.ndarray, " T"], window: int) -> Float[np.ndarray, "T 3"]:
    """Corrections at the frames that are held; before and after them what the nearest has, fading out smoothly.

    Between two that are nearer than twice the window it goes from the one to the other.
    """
    frames, at = np.arange(len(by)), np.flatnonzero(held)
    if not len(at):
        return np.zeros_like(by)
    place = np.searchsorted(at, frames)
    last, following = at[(place - 1).clip(0)], at[place.clip(max=len(at) - 1)]
    since = np.where(last <= frames, frames - last, np.inf)
    until = np.where(following >= frames, following - frames, np.inf)
    a, b = _fading(since / window), _fading(until / window)
    share = np.maximum(a + b, 1.0)
    found: np.ndarray = (a / share)[:, None] * by[last] + (b / share)[:, None] * by[following]
    return np.where(held[:, None], by, found)


def between(a: Float[np.ndarray, "T 3"], b: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, "T 3 3"]:
    """The smallest rotations that take directions to others, which are not opposed to them."""
    a, b = _unit(a)[0], _unit(b)[0]
    axis, cosine = np.cross(a, b), _dot(a, b)
    cross = np.zeros((len(a), 3, 3))
    cross[:, [2, 0, 1], [1, 2, 0]] = axis
    cross[:, [1, 2, 0], [2, 0, 1]] = -axis
    turn: np.ndarray = np.eye(3) + cross + cross @ cross / np.maximum(1 + cosine, 1e-9)[:, None, None]
    return turn


def _fading(x: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
    """1 at 0, 0 from 1 on, level at both ends."""
    x = np.minimum(x, 1.0)
    fade: np.ndarray = 1 - x * x * (3 - 2 * x)
    return fade


def _unit(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors, and how long they were."""
    lengths = np.linalg.norm(vectors, axis=-1)
    return vectors / np.maximum(lengths, 1e-12)[..., None], lengths


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    product: np.ndarray = (a * b).sum(axis=-1)
    return product
