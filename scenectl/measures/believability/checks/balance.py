"""The centre of mass over what supports it."""

from __future__ import annotations

import numpy as np

from scenectl.measures.believability.checks.check import Check, Found
from scenectl.measures.believability.evidence import RATE, Evidence, averages
from scenectl.measures.believability.words import centimetres, span

REACH = 0.05
"""Parts of an adult no higher (m) than this over the lowest part support the body; others' in proportion."""
DIRECTIONS = 32
WINDOW = 2.5


def balance(evidence: Evidence) -> Found | None:
    """How far (m) the weight acts outside of what supports it, on average over `WINDOW` s.

    In each frame it acts at the zero moment point, c - h a / (g + a_up), c and a the centre of mass and its
    acceleration over the ground, h its height (M. Vukobratovic, B. Borovac, Zero-moment point: thirty five years of its
    life, Int. J. of Humanoid Robotics 1, 2004): under the centre of mass where that is slow. From the convex hull of
    supporting parts to there is a vector; vectors are averaged with the load as weight, so that a step's falling and
    catching cancel.
    """
    if evidence.frames < 10:
        return None
    center, carried = evidence.center, evidence.carried
    height = center[:, 1] - (carried.points[..., 1] - carried.heights).min(axis=1)
    bearing = np.maximum(evidence.load, 0.2)
    acts = center[:, ::2] - (height / bearing)[:, None] * evidence.pushed[:, ::2]
    outside = _outside(
        acts, carried.points[..., ::2], carried.heights <= carried.lowest[:, None] + REACH * evidence.size
    )
    means = np.linalg.norm(averages(outside * bearing[:, None], WINDOW), axis=1)
    first = int(means.argmax())
    last = min(first + round(WINDOW * RATE), evidence.frames) - 1
    value = float(means[first])
    told = f"the weight is {centimetres(value)} off what supports it {span(evidence.times, first, last)}"
    return Found(value, told, float(evidence.times[(first + last) // 2]))


def _outside(points: np.ndarray, support: np.ndarray, holds: np.ndarray) -> np.ndarray:
    """From the convex hull of those of ``support [T, P, 2]`` that hold to ``points [T, 2]``; 0 inside, ``[T, 2]``."""
    angles = np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS)
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    edges = np.where(holds[..., None], support @ ways.T, -np.inf).max(axis=1)
    over = points @ ways.T - edges
    best = over.argmax(axis=1)
    away = np.maximum(over[np.arange(len(points)), best], 0.0)
    vectors: np.ndarray = away[:, None] * ways[best]
    return vectors


CHECKS = (Check("balance", "m", balance, share=0.9925, explains=1, grows=True),)
