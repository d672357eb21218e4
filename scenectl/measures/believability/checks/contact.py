"""The body in things: at the frames, on the way between them, and beyond the free space that it began in."""

from __future__ import annotations

from itertools import product

import numpy as np
import torch

from scenectl.measures.believability.checks.check import Check, Found
from scenectl.measures.believability.evidence import Evidence
from scenectl.measures.believability.words import centimetres, part_name
from scenectl.measures.metrics import SHALLOW, Scorer
from scenes.mesh.primitives import Plane
from scenes.motion.motion import Motion

STEP = 0.005
"""Metres of way below which nothing is looked for between two places of a sample."""
PIECES = 4


def counted(evidence: Evidence) -> np.ndarray:
    """Which samples count in which frames, ``[T, M]``: those that no goal exempts."""
    names, scorer = evidence.given.skeleton.names, evidence.scorer
    owners = np.array([names[joint] for joint in scorer.owners])
    times = evidence.given.times.detach().cpu().double().numpy()
    counts = np.ones((len(times), len(owners)), dtype=bool)
    for joints, windows in evidence.exemptions:
        parts = np.isin(owners, joints) if joints else np.ones(len(owners), dtype=bool)
        when = np.zeros(len(times), dtype=bool) if windows is not None else np.ones(len(times), dtype=bool)
        for begin, end in windows or ():
            when |= (times >= begin - 1e-6) & (times <= end + 1e-6)
        counts &= ~(when[:, None] & parts)
    return counts


def _depths(evidence: Evidence) -> np.ndarray:
    """How deep (m) every sample is in obstacles or the floor, ``[T, M]``."""
    return np.maximum(np.maximum(-evidence.depths.rooms, evidence.depths.sunk), 0.0)


def penetration(evidence: Evidence) -> Found | None:
    """The deepest sample (m) of the body in obstacles or the ground, of those that are not exempted."""
    if not evidence.given.frames:
        return None
    depths = np.where(counted(evidence), _depths(evidence), 0.0)
    frame, sample = np.unravel_index(int(depths.argmax()), depths.shape)
    deepest, at = float(depths[frame, sample]), float(evidence.given.times[frame])
    part = part_name(evidence.scorer.part(int(sample)))
    where = _thing(evidence, int(frame), int(sample))
    return Found(deepest, f"{part} {centimetres(deepest)} deep in {where} at {at:.2f} s", at, part)


def exempted(evidence: Evidence) -> tuple[str, ...]:
    """What the goals exempted and how deep it went: a sentence for each part that is deeper than `SHALLOW`."""
    depths = np.where(counted(evidence), 0.0, _depths(evidence))
    told: dict[str, tuple[float, str]] = {}
    for sample in np.flatnonzero(depths.max(axis=0, initial=0.0) > SHALLOW):
        frame = int(depths[:, sample].argmax())
        deep, part = float(depths[frame, sample]), part_name(evidence.scorer.part(int(sample)))
        sentence = (
            f"{part}, exempted, {centimetres(deep)} deep in {_thing(evidence, frame, int(sample))} "
            f"at {float(evidence.given.times[frame]):.2f} s"
        )
        told[part] = max(told.get(part, (0.0, "")), (deep, sentence))
    return tuple(sentence for _, sentence in sorted(told.values(), reverse=True))


def _thing(evidence: Evidence, frame: int, sample: int) -> str:
    """What a sample is deepest in: the thing's name, or the floor."""
    depths, scorer = evidence.depths, evidence.scorer
    if depths.sunk[frame, sample] >= -depths.rooms[frame, sample]:
        return "the floor"
    point = scorer.points(evidence.given.joints[frame : frame + 1].detach().cpu().double().numpy())[:, sample]
    return f"the {nearest_thing(scorer, point, float(evidence.given.times[frame]))}"


def nearest_thing(scorer: Scorer, point: np.ndarray, time: float) -> str:
    """Name of the mesh, object or primitive that a point, ``[1, 3]``, is deepest in or nearest to."""
    scene, when = scorer.scene, np.array([time])
    found = [
        (float(shape.distance(torch.from_numpy(point), torch.from_numpy(when))), type(shape).__name__.lower())
        for shape in scene.primitives
        if not isinstance(shape, Plane)
    ]
    found += [(float(thing.distance_exact(point, when)[0]), thing.name) for thing in scene.objects]
    nearest = min(found, default=(np.inf, "obstacle"))
    if nearest[0] > 0:  # what a mesh encloses has no inside here: the nearest surface is what one is in
        apart = [(float(surface.unsigned_distance(point)[0]), name) for name, surface in scorer.surfaces]
        nearest = min([nearest, *apart])
    return nearest[1]


def crossing(evidence: Evidence) -> Found | None:
    """How deep (m) the body is in obstacles on its way between two frames in neither of which it is.

    Joints go along cubic splines through the frames: a foot that swings over an edge does not cut it. A sample's room
    changes by no more than the ways that it and things go, so halves of a way that may hold a depth of more than
    `SHALLOW` are looked at until they are shorter than `STEP`.
    """
    given, scorer = evidence.given, evidence.scorer
    if given.frames < 2:
        return None
    clear = (evidence.depths.rooms > -SHALLOW) & counted(evidence)
    frames, samples = np.nonzero(clear[1:] & clear[:-1])
    room = np.stack([evidence.depths.rooms[frames, samples], evidence.depths.rooms[frames + 1, samples]], axis=1)
    near = np.isfinite(room).all(axis=1)
    frames, samples, room = frames[near], samples[near], room[near]
    share = np.tile([0.0, 1.0], (len(frames), 1))
    worst, found = 0.0, Found(0.0, "nothing is crossed between frames")
    way = _Ways(given, scorer) if len(frames) else None
    while way is not None:
        length = way.longest[frames, samples] * np.ptp(share, axis=1)
        # The least that the room can be in between, by both ends.
        near = ((room.sum(axis=1) - length) / 2 < -SHALLOW) & (length > STEP)
        frames, samples, share, room = frames[near], samples[near], share[near], room[near]
        if not len(frames):
            break
        half = share.mean(axis=1)
        points, times = way.at(frames, samples, half), given.t0 + (frames + half) / given.fps
        between = scorer.room(points, times, samples)
        k = int(between.argmin())
        if between[k] < worst:
            worst, at, part = float(between[k]), float(times[k]), part_name(scorer.part(int(samples[k])))
            thing = nearest_thing(scorer, points[k : k + 1], at)
            told = f"{part} goes {centimetres(-worst)} through the {thing} between frames at {at:.2f} s"
            found = Found(-worst, told, at, part)
        frames, samples = np.tile(frames, 2), np.tile(samples, 2)
        share = np.concatenate([np.stack([share[:, 0], half], 1), np.stack([half, share[:, 1]], 1)])
        room = np.concatenate([np.stack([room[:, 0], between], 1), np.stack([between, room[:, 1]], 1)])
    return found


class _Ways:
    """Ways of samples from frame to frame, in `PIECES` straight pieces along splines."""

    def __init__(self, given: Motion, scorer: Scorer) -> None:
        joints = given.joints.detach().cpu().double().numpy()
        if len(joints) > 3:
            from scipy.interpolate import CubicSpline

            fine = np.linspace(0, len(joints) - 1, PIECES * (len(joints) - 1) + 1)
            joints = CubicSpline(np.arange(len(joints)), joints)(fine)
            self._pieces = PIECES
        else:
            self._pieces = 1
        self._places = scorer.points(joints)
        steps = np.linalg.norm(np.diff(self._places, axis=0), axis=-1)
        times = given.t0 + np.arange(len(joints)) / (given.fps * self._pieces)
        steps = steps + _things_go(scorer, times)[:, None]
        self.longest = self._pieces * steps.reshape(-1, self._pieces, steps.shape[1]).max(axis=1)
        """Bound on the way (m) from each frame to the next beside what moves, ``[T - 1, M]``."""

    def at(self, frames: np.ndarray, samples: np.ndarray, share: np.ndarray) -> np.ndarray:
        """Places ``[n, 3]`` (m) at shares of the ways from frames on."""
        where = frames * self._pieces + share * self._pieces
        first = np.minimum(where.astype(int), len(self._places) - 2)
        a, b = self._places[first, samples], self._places[first + 1, samples]
        return a + (where - first)[:, None] * (b - a)


def _things_go(scorer: Scorer, times: np.ndarray) -> np.ndarray:
    """The longest way (m) of any point of what moves in the scene, between times (s) that follow each other."""
    when, tracks = torch.from_numpy(times), []
    for thing in scorer.scene.objects:
        corners = torch.from_numpy(np.array(list(product(*thing.solid.bounds.T))))  # no point of it goes further
        tracks.append(thing.world(corners[:, None].expand(-1, len(times), -1), when))
    for shape in scorer.scene.primitives:
        if (way := getattr(shape, "motion", None)) is not None:
            tracks.append(way.at(when)[None])
    ways = [torch.diff(track, dim=1).norm(dim=-1).amax(dim=0).numpy() for track in tracks]
    return np.maximum.reduce([np.zeros(len(times) - 1), *ways])


def beyond(evidence: Evidence) -> Found | None:
    """How far (m) the body is outside of the free space that its start is connected to, by the way back."""
    if not evidence.given.frames:
        return None
    frame = int(evidence.depths.beyond.argmax())
    far, at = float(evidence.depths.beyond[frame]), float(evidence.given.times[frame])
    return Found(far, f"{far:.2f} m outside of the free space that it started in, by the way back, at {at:.2f} s", at)


_TOUCH = "what reports and previews call a touch (`scenectl.measures.metrics.SHALLOW`)"

CHECKS = (
    Check("penetration", "m", penetration, SHALLOW, _TOUCH),
    Check("crossing", "m", crossing, SHALLOW, _TOUCH),
    Check("left_free_space", "m", beyond, SHALLOW, _TOUCH, explains=1),
)
