"""Rotations of joints against two truths: recorded motions, and a body moved by rotations whose joints alone are given.

A recording tells no rotations, but what turns while nothing around it moves is wrong (`still_turns`). A body that is
moved by smooth random rotations within the limits of people's joints tells what every rotation should have been.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d
from scipy.special import ndtr
from torch import Tensor

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.bench.models.gallery import PROMPTS
from scenectl.data.corpus import load_motions
from scenectl.data.formats.motions import load_motion
from scenectl.generators.base import Generator
from scenes.motion.bones import stretches
from scenes.motion.kinematics import forward, orientations
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.rigid import rigid
from scenes.motion.rotations import about, angle, unit_quaternions
from scenes.motion.skeleton import HUMANML3D, Skeleton

STILL = 0.03
"""Metres: where joints around one move less from a frame to the next, it turns by no more than `LARGEST`."""
LARGEST = 30.0
"""Degrees."""
LONG = (("a person walks forward.", 60.0),)
"""Beside the gallery's prompts."""
LIMITS = {
    "spine": ((-10, 25), (-12, 12), (-10, 10)),
    "neck": ((-30, 30), (-40, 40), (-20, 20)),
    "hip": ((-110, 20), (-30, 30), (-20, 35)),
    "knee": ((0, 130), (0, 0), (0, 0)),
    "ankle": ((-35, 20), (-10, 10), (-10, 10)),
    "collar": ((-5, 5), (-20, 20), (-10, 15)),
    "shoulder": ((-80, 80), (-110, 30), (-85, 60)),
    "elbow": ((0, 0), (-140, 0), (0, 0)),
}
"""Degrees about x, y and z (of the left side) within which joints of people stay, by the beginning or end of a name.

They lie within the ranges that the American Academy of Orthopaedic Surgeons gives (Joint Motion, 1965). Bones of upper
limbs swing first and then turn about themselves (thighs about y, upper arms about x). Forearms turn at the wrist.
"""
_SWEEP = 0.4
"""Seconds: width of the Gaussian that smooths random angles, which makes joints turn as fast as in a brisk walk."""


def bench_rotations(
    data: str | Path,
    split: str = "test",
    animated: int = 30,
    seed: int = 0,
    files: Sequence[Path] = (),
    generator: Generator | None = None,
    engine: Engine = ENGINE,
) -> Result:
    """Measure the rotations of recorded, animated, stored and generated motions.

    Args:
        data: folder of the motion collection; its clips are put on our bones.
        split: of it.
        animated: bodies that are moved by random rotations, for 20 s each.
        seed: of those, and of what is generated.
        files: motions to measure as they are.
        generator: makes the gallery's prompts, and a minute; None for none.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary", "rows"}``: a row for all recorded clips, one for each file, prompt, and joint of the animated.
    """
    clips = [clip for clip in load_motions(data, (split,)) if clip.frames > 1]
    cases: list[tuple[str, Any]] = [
        ("recorded", lambda clip=clip: _figures(rigid(Motion(clip.joints)), "recorded", clip.id)) for clip in clips
    ]
    cases += [("animated", partial(_errors, seed + i)) for i in range(animated)]
    cases += [(str(path), lambda path=path: _figures(load_motion(path), "file", str(path))) for path in files]
    if generator is not None:
        cases += [(words, partial(_made, generator, words, seconds, seed)) for words, seconds in (*PROMPTS, *LONG)]
    settings = {"bench": "rotations", "split": split, "seed": seed, "files": [str(path) for path in files]}
    result = engine.run(cases, lambda case: case(), _summary, settings)
    return result if "left" in result else {"summary": result["summary"], "rows": [*_table(result["rows"])]}


def still_turns(motion: Motion) -> Float[Tensor, "*b S J"]:
    """By how much (degrees) each joint turns from a frame to the next, in the world or against its parent.

    0 where a joint at most two bones away (its limb) moves by `STILL` or more meanwhile.
    """
    world, parents = orientations(motion), list(motion.skeleton.parents[1:])
    local = torch.cat([world[..., :1, :, :], world[..., parents, :, :].mT @ world[..., 1:, :, :]], dim=-3)
    turns = torch.maximum(*(angle(r[..., 1:, :, :, :].mT @ r[..., :-1, :, :, :]) for r in (world, local)))
    steps = motion.joints.diff(dim=-3).norm(dim=-1)
    moved = torch.where(_near(motion.skeleton), steps[..., None, :], 0.0).amax(-1)
    return torch.rad2deg(turns) * (moved < STILL)


def _near(skeleton: Skeleton) -> Tensor:
    """Joints ``[J, J]`` at most two bones from each other."""
    linked = torch.eye(len(skeleton.names))
    for parent, child in skeleton.bones:
        linked[parent, child] = linked[child, parent] = 1
    return linked @ linked > 0


def _figures(motion: Motion, kind: str, name: str) -> list[Row]:
    turns = still_turns(motion)
    back = forward(motion.rotations, motion.joints[..., 0, :], motion.skeleton)
    where = int(turns.flatten(end_dim=-2).amax(0).argmax())
    return [
        {
            "set": kind,
            "name": name,
            "motions": int(motion.joints[..., 0, 0, 0].numel()),
            "frames": int(motion.joints[..., 0, 0].numel()),
            "bones_m": float(stretches(motion).abs().max()),
            "fk_m": float((back - motion.joints).norm(dim=-1).max()),
            "turn_deg": float(turns.max()),
            "joint": motion.skeleton.names[where],
            "flips": int((turns > LARGEST).sum()),
        }
    ]


def _made(generator: Generator, words: str, seconds: float, seed: int) -> list[Row]:
    motion = generator.generate(words, seconds, Pose2D(), samples=3 if seconds < 60 else 1, seed=seed).motion
    return _figures(motion, "generated", f"{words} {seconds:g} s")


def animated(frames: int, seed: int, fps: float = 20.0) -> tuple[Float[Tensor, "T J 3 3"], Motion]:
    """A body moved by smooth random rotations within `LIMITS`: how its joints are turned in the world, and they."""
    draw, names = np.random.default_rng(seed), HUMANML3D.names

    def angles(limits: Any) -> tuple[Tensor, ...]:
        smooth = gaussian_filter1d(draw.standard_normal((3, frames)), _SWEEP * fps, axis=1)
        share = ndtr(smooth / smooth.std(axis=1, keepdims=True))
        low, high = np.radians(np.array(limits, float)).T[..., None]
        return torch.from_numpy(low + (high - low) * share).unbind()

    x, y, z = angles(((-25, 25), (-180, 180), (-25, 25)))
    local = [about(1, y) @ about(0, x) @ about(2, z)]
    for name in names[1:]:
        side, part = -1 if name.startswith("right") else 1, name.split("_")[-1].rstrip("123")
        x, y, z = angles(LIMITS.get(part, ((0, 0),) * 3))
        y, z = side * y, side * z
        if part == "shoulder":
            local.append(about(2, z) @ about(1, y) @ about(0, x))
        else:
            local.append(about(2, z) @ about(0, x) @ about(1, y))
    world = local[:1]
    for joint, parent in enumerate(HUMANML3D.parents[1:], 1):
        world.append(world[parent] @ local[joint])
    turns, root = unit_quaternions(torch.stack(local, dim=1)), torch.zeros(frames, 3, dtype=torch.float64)
    return torch.stack(world, dim=1), Motion(forward(turns, root, HUMANML3D), fps=fps)


def _errors(seed: int) -> list[Row]:
    """A row for each joint but the leaves, which turn as their parents do by rule."""
    truth, motion = animated(400, seed)
    found, rows = orientations(motion), []
    wrong = torch.rad2deg(angle(truth.mT @ found))
    ours, theirs = (torch.rad2deg(angle(r[1:].mT @ r[:-1])) for r in (found, truth))
    for joint in sorted(set(HUMANML3D.parents[1:])):
        flips = int((ours[:, joint] - theirs[:, joint] > LARGEST).sum())
        off = [round(value, 3) for value in wrong[:, joint].tolist()]
        rows.append({"set": "animated", "name": HUMANML3D.names[joint], "off_deg": off, "flips": flips})
    return rows


def _table(rows: Sequence[Row]) -> Iterator[Row]:
    recorded = [row for row in rows if row["set"] == "recorded"]
    if recorded:
        yield _together(recorded)
    moved = sorted((row for row in rows if row["set"] == "animated"), key=lambda row: HUMANML3D.index(row["name"]))
    for name, some in groupby(moved, key=lambda row: str(row["name"])):
        mine = list(some)
        off = np.concatenate([row["off_deg"] for row in mine])
        yield {
            "set": "animated",
            "name": name,
            "motions": len(mine),
            "frames": len(off),
            "flips": sum(row["flips"] for row in mine),
            "median_deg": float(np.median(off)),
            "q95_deg": float(np.quantile(off, 0.95)),
        }
    yield from (row for row in rows if row["set"] not in ("recorded", "animated"))


def _together(rows: Sequence[Row]) -> Row:
    worst = max(rows, key=lambda row: row["turn_deg"])
    return {
        **worst,
        **{key: sum(row[key] for row in rows) for key in ("motions", "frames", "flips")},
        **{key: max(row[key] for row in rows) for key in ("bones_m", "fk_m")},
        "flipped": sum(row["flips"] > 0 for row in rows),
    }


def _summary(rows: Sequence[Row]) -> Row:
    still = [row for row in rows if row["set"] != "animated"]
    return {
        "still_turns_over_30": sum(row["flips"] for row in still),
        "largest_still_turn_deg": max((row["turn_deg"] for row in still), default=None),
        "largest_fk_error_m": max((row["fk_m"] for row in still), default=None),
        "largest_bone_error_m": max((row["bones_m"] for row in still), default=None),
        "flips_of_twist": sum(row["flips"] for row in rows if row["set"] == "animated"),
    }
