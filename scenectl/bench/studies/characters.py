"""Characters that play motions: whether feet that stand slide or sink, bones keep their length, and knees bend."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.data.formats.motions import load_motion, one_of
from scenectl.export.animation import Animation
from scenectl.retarget.characters.character import Character
from scenectl.retarget.characters.playing import Played, play
from scenectl.retarget.plants import Plant
from scenes.motion.kinematics import carried
from scenes.motion.skeleton import HUMANML3D

_ARMS = ("left_elbow", "right_elbow", "left_wrist", "right_wrist")


def bench_characters(characters: Sequence[Path], motions: Sequence[Path], engine: Engine = ENGINE) -> Result:
    """Let characters play motions, and measure them as whoever reads the written animation sees them.

    Args:
        characters: skinned glTF or VRM files.
        motions: files or folders of results; the first motion of each.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary", "rows"}``: a row for each character and motion.
    """
    cases = [
        (f"{hero.name}: {motion.parent.name}/{motion.name}", partial(_row, hero, motion))
        for hero in characters
        for motion in motions
    ]
    settings = {"bench": "characters", "characters": [*map(str, characters)], "motions": [*map(str, motions)]}
    return engine.run(cases, lambda case: case(), _summary, settings)


def _row(hero: Path, motion: Path) -> list[Row]:
    character = Character.load(hero)
    animation, _ = Animation.of(one_of(load_motion(motion), 0, motion))
    start = time.perf_counter()
    played = play(character, animation.skeleton, animation.rotations, animation.roots, animation.fps)
    seconds = time.perf_counter() - start
    row = {"character": hero.name, "motion": str(motion), "frames": animation.frames, "stands": len(played.stands)}
    row |= {"ratio": played.ratio, "lowered_m": played.lowered, "seconds": seconds}
    return [row | figures(character, played, animation)]


def figures(character: Character, played: Played, animation: Animation) -> dict[str, float]:
    """What is measured on a character that plays an animation.

    Returns:
        slide_max_m: the farthest that an ankle or toe joint goes from its mean place while it is held.
        sink_max_m: the farthest that a sole is then under the lowest ground on which a ball stands.
        float_max_m: the farthest that the lowest point of a sole is over the ground on which its ball stands.
        stretch_max_m: by how much a bone is longer or shorter than at rest.
        knee_min_deg: the least bend of a knee; below 0 it bends forward.
        arm_max_deg: the largest angle between the bones of arms and those of the motion.
        turn_max_deg: the most that a joint turns between two frames, beyond what the motion's turns.
    """
    worlds = played.worlds(character.file)
    places = worlds[..., :3, 3]
    found = {"slide_max_m": 0.0, "sink_max_m": 0.0, "float_max_m": 0.0}
    grounds = [stand.place[1] - _height(character, stand) for stand in played.stands]
    level = min((g for g, s in zip(grounds, played.stands, strict=True) if s.joint.endswith("foot")), default=-np.inf)
    for stand, ground in zip(played.stands, grounds, strict=True):
        held, low = slice(stand.begin, stand.end), _low(character, worlds, stand)
        path = places[held, character.joints[stand.joint]] if stand.joint in character.joints else stand.place[None]
        slide = np.linalg.norm(path - path.mean(axis=0), axis=-1).max()
        found["slide_max_m"] = max(found["slide_max_m"], float(slide))
        found["sink_max_m"] = max(found["sink_max_m"], float(level - low.min()))
        if stand.joint.endswith("foot"):
            found["float_max_m"] = max(found["float_max_m"], float(low.max() - ground))
    nodes = [character.joints[name] for name in HUMANML3D.names if name in character.joints]
    above = {node: character.loose.get(node, character.file.parents[node]) for node in nodes}
    bones = [(above[node], node) for node in nodes if node != character.mover]
    lengths = np.stack([np.linalg.norm(places[:, b] - places[:, a], axis=-1) for a, b in bones])
    rest = [np.linalg.norm(character.origins[b] - character.origins[a]) for a, b in bones]
    found["stretch_max_m"] = float(np.abs(lengths - np.array(rest)[:, None]).max())
    found["knee_min_deg"] = _knees(character, played)
    found["arm_max_deg"] = _arms(played, animation)
    found["turn_max_deg"] = _turns(played, animation)
    return found


def _soles(character: Character, stand: Plant) -> list[tuple[int, np.ndarray]]:
    """Nodes of a foot that stands, with the points (m, at rest) that move with each."""
    foot = character.joints[f"{stand.joint.partition('_')[0]}_ankle"]
    parts = [(character.file.joints[character.rig.index(part.link)], part.placed) for part in character.rig.parts]
    return [(node, points) for node, points in parts if foot in character.goes_with(node)]


def _height(character: Character, stand: Plant) -> float:
    """How high (m) over its sole the joint that stands is at rest."""
    node = character.joints.get(stand.joint)
    at = character.place[HUMANML3D.index(stand.joint)] if node is None else character.origins[node]
    return float(at[1] - min(points[:, 1].min() for _, points in _soles(character, stand)))


def _low(character: Character, worlds: np.ndarray, stand: Plant) -> np.ndarray:
    """Height (m, world) of the lowest point of a foot in the frames in which it stands, ``[n]``."""
    low = []
    for node, points in _soles(character, stand):
        frame = worlds[stand.begin : stand.end, node] @ np.linalg.inv(character.file.world[node])
        low.append((points @ frame[:, 1, :3].T + frame[:, 1, 3]).min(axis=0))
    lowest: np.ndarray = np.min(low, axis=0)
    return lowest


def _knees(character: Character, played: Played) -> float:
    """The least bend (degrees) of a knee, seen from the side on which its thigh's joint bends it."""
    least = 180.0
    for side in ("left", "right"):
        hip, knee, ankle = HUMANML3D.indices([f"{side}_hip", f"{side}_knee", f"{side}_ankle"])
        hinge = played.turns[:, hip] @ character.turned[hip][:, 0]
        upper, lower = np.diff(played.joints[:, [hip, knee, ankle]], axis=1).swapaxes(0, 1)
        bend = np.arctan2((np.cross(upper, lower) * hinge).sum(-1), (upper * lower).sum(-1))
        least = min(least, float(np.degrees(bend).min()))
    return least


def _arms(played: Played, animation: Animation) -> float:
    ours = animation.joints[:, animation.ours]
    ends = HUMANML3D.indices(list(_ARMS))
    above = [HUMANML3D.parents[end] for end in ends]
    a, b = (joints[:, ends] - joints[:, above] for joints in (ours, played.joints))
    turn = np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(-1))
    return float(np.degrees(turn).max())


def _turns(played: Played, animation: Animation) -> float:
    if animation.frames < 2:
        return 0.0
    most = []
    ours = carried(torch.from_numpy(animation.rotations), animation.skeleton).numpy()
    for turns in (played.turns, ours[:, animation.ours]):
        between = turns[:-1].swapaxes(-1, -2) @ turns[1:]
        cosine = (np.trace(between, axis1=-2, axis2=-1) - 1) / 2
        most.append(np.degrees(np.arccos(cosine.clip(-1, 1))))
    return float((most[0] - most[1]).max())


def _summary(rows: Sequence[Row]) -> dict[str, Any]:
    most = ("slide_max_m", "sink_max_m", "float_max_m", "stretch_max_m", "arm_max_deg", "seconds")
    return {"rows": len(rows), **{name: max(row[name] for row in rows) for name in most}} if rows else {"rows": 0}
