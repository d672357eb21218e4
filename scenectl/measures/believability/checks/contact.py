"""The body in things: at the frames, on the way between them, and beyond the free space that it began in."""

from __future__ import annotations

import numpy as np
import torch

from scenectl.measures.believability.checks.check import Check, Found
from scenectl.measures.believability.evidence import Evidence
from scenectl.measures.believability.words import centimetres, part_name
from scenectl.measures.metrics import SHALLOW, Scorer
from scenes.mesh.primitives import Plane

STEP = 0.005
"""Metres of way below which nothing is looked for between two places of a sample."""


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
    told = {}
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

    Every sample moves straight from frame to frame. Its room changes by no more than the way that it moves, so halves
    of a way that may hold a depth of more than `SHALLOW` are looked at until they are shorter than `STEP`.
    """
    given, scorer = evidence.given, evidence.scorer
    if given.frames < 2:
        return None
    places = scorer.points(given.joints.detach().cpu().double().numpy())
    times = given.times.detach().cpu().double().numpy()
    rooms, counts = evidence.depths.rooms, counted(evidence)
    clear = (rooms > -SHALLOW) & counts
    frames, samples = np.nonzero(clear[1:] & clear[:-1])
    share = np.tile([0.0, 1.0], (len(frames), 1))
    room = np.stack([rooms[frames, samples], rooms[frames + 1, samples]], axis=1)
    worst, worst_at = np.inf, (0, 0, 0.0)
    while True:
        way = np.linalg.norm(places[frames + 1, samples] - places[frames, samples], axis=1) * np.ptp(share, axis=1)
        # The least that the room can be in between, by both ends.
        near = ((room.sum(axis=1) - way) / 2 < -SHALLOW) & (way > STEP)
        frames, samples, share, room = frames[near], samples[near], share[near], room[near]
        if not len(frames):
            break
        half = share.mean(axis=1)
        points = places[frames, samples] + half[:, None] * (places[frames + 1, samples] - places[frames, samples])
        between = scorer.room(points, times[frames] + half * (times[frames + 1] - times[frames]), samples)
        if between.min() < worst:
            k = int(between.argmin())
            worst, worst_at = float(between[k]), (int(frames[k]), int(samples[k]), float(half[k]))
        frames, samples = np.tile(frames, 2), np.tile(samples, 2)
        share = np.concatenate([np.stack([share[:, 0], half], 1), np.stack([half, share[:, 1]], 1)])
        room = np.concatenate([np.stack([room[:, 0], between], 1), np.stack([between, room[:, 1]], 1)])
    frame, sample, part_way = worst_at
    at = float(times[frame] + part_way / given.fps)
    part = part_name(scorer.part(sample))
    if worst >= 0:
        return Found(0.0, "nothing is crossed between frames")
    point = places[frame : frame + 1, sample] + part_way * (places[frame + 1, sample] - places[frame, sample])
    thing = nearest_thing(scorer, point, at)
    return Found(
        -worst, f"{part} goes {centimetres(-worst)} through the {thing} between frames at {at:.2f} s", at, part
    )


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
