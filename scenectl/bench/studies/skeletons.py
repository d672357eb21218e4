"""Where hips and collars of recorded people are, by source, beside those of the body that all motions are put on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.data import held_out
from scenectl.data.corpus import Clip, load_motions
from scenes.motion.branches import tree_of, turns
from scenes.motion.rigid import on_bones
from scenes.motion.skeleton import COLLAR, HIP, HUMANML3D

PARTS = {"hip": ("left_hip", "right_hip"), "collar": ("left_collar", "right_collar")}
_ENDS = HUMANML3D.indices(("left_foot", "right_foot", "left_wrist", "right_wrist", "head"))


def bench_skeletons(data: str | Path, engine: Engine = ENGINE) -> Result:
    """Clips of all splits, each with HumanML3D's lengths, its own hips and collars, and equal weight.

    Args:
        data: folder of the motion collection.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary", "rows"}``, a row for each source: angles (degrees) of the bones to hips and to collars from the
        vertical of pelvis and chest, their standard deviation between clips and, the median, over a clip's frames; and
        how far (m) our body's hips and collars, and ends of limbs, are from the clips' own.
    """
    clips = load_motions(data, ("train", "val", "test", held_out.SPLIT))
    sources = sorted({clip.source for clip in clips})
    cases = [(source, [clip for clip in clips if clip.source == source]) for source in sources]
    return engine.run(cases, lambda some: [_row(some)], _summary, {"bench": "skeletons", "data": data})


def _row(clips: Sequence[Clip]) -> Row:
    joints = [clip.joints.double() for clip in clips]
    row: Row = {"source": clips[0].source, "clips": len(clips)}
    for part, names in PARTS.items():
        angles = [_angles(each, HUMANML3D.indices(names)) for each in joints]
        means = torch.stack([angle.mean() for angle in angles])
        row[f"{part}_deg"] = float(means.mean())
        row[f"{part}_between_clips_deg"] = float(means.std(correction=0))
        row[f"{part}_within_clip_deg"] = float(torch.stack([a.std(0, correction=0).mean() for a in angles]).median())
    moved = [(on_bones(each, HUMANML3D) - each).norm(dim=-1).mean(0) for each in joints]
    for part, names in PARTS.items():
        row[f"{part}_moved_m"] = float(torch.stack(moved)[:, HUMANML3D.indices(names)].mean())
    row["limb_ends_moved_m"] = float(torch.stack(moved)[:, _ENDS].mean())
    return row


def _angles(joints: Float[Tensor, "T 22 3"], ends: list[int]) -> Float[Tensor, "T 2"]:
    """Of both bones from the up or down of the joint that they leave, degrees."""
    branch = next(b for b in tree_of(HUMANML3D).branches if ends[0] - 1 in b.bones)
    bones = joints[:, [bone + 1 for bone in branch.bones]] - joints[:, [branch.joint]]
    up = turns(bones, branch)[..., 1]
    out = joints[:, ends] - joints[:, [branch.joint]]
    cosine = (out * up[:, None]).sum(-1) / out.norm(dim=-1)
    return torch.rad2deg(cosine.abs().clamp(max=1).acos())


def _summary(rows: Sequence[Row]) -> dict[str, Any]:
    sines = {"hip": HIP, "collar": COLLAR}
    ours = {f"our_{part}_deg": math.degrees(math.asin(sine)) for part, sine in sines.items()}
    return {**ours, "clips": sum(row["clips"] for row in rows)}
