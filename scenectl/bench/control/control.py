"""Ways of reaching keyframes, side by side: the paper's, ControlMM's, Adam, L-BFGS and ours, on the same motions."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from objectives import Term
from scenectl.bench.control.keyframes import (
    DENSITIES,
    FAILED,
    FLOOR,
    JOINTS,
    SHORTEST,
    Keyframes,
    longest,
    usable_clips,
)
from scenectl.bench.control.rivals import METHODS, Case, Way, possible, remembering, ways
from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.data.corpus import Clip
from scenectl.generators.base import Generator
from scenectl.generators.spec import Spec
from scenectl.measures.metrics import Scorer, max_acceleration, skating_ratio
from scenectl.tasks.schema import AVOID
from scenes.errors import UserError, did_you_mean
from scenes.files import atomic_write
from scenes.mesh.primitives import Cylinder
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D
from scenes.world.scene import Scene

SCENES = ("empty", "pillars")
PILLARS, RADIUS, HEIGHT = 3, 0.2, 2.2
NEAREST, FURTHEST = 0.05, 0.3
"""Metres between a pillar and the body of the recording, where that is nearest."""
TRIES = 300
"""Draws of a pillar; with fewer than `PILLARS` found by then, a scene has fewer."""
_CLEAR = Term.from_table({"use": "sdf_penetration", **AVOID})


def bench_control(
    generator: Generator,
    data: str | Path,
    clips: int = 2,
    methods: Sequence[str] = (),
    joints: Sequence[str] = JOINTS,
    densities: Sequence[str] = tuple(DENSITIES),
    scenes: Sequence[str] = ("empty",),
    shortest: int = SHORTEST,
    seed: int = 0,
    engine: Engine = ENGINE,
) -> Result:
    """Every method on every case, in turn, at batch 1; texts are encoded before the clock starts.

    Args:
        generator: whose tokens and decoder all methods share.
        data: folder of the motion collection.
        clips: test clips for each joint and density.
        methods: of `METHODS`; by default all that run with the generator.
        joints, densities: of `JOINTS` and `DENSITIES`.
        scenes: "empty", or "pillars" that stand close to the recording's way, which touches none; there a body has to
            keep out of them besides.
        shortest: frames that a clip has at least; with 196, all are as long as a motion can be.
        seed: of clips, frames and motions.
        engine: tells progress, keeps rows and goes on from them.

    Raises:
        UserError: a method, joint, density or scene that is not known, or no clip.

    Returns:
        ``{"summary", "rows"}``: a row for each method and case, and for the same sample without control
        (`uncontrolled`); seconds, decoder passes, metres. The summary has medians of times and passes and means of
        everything else, by method and density, medians of times of 196 frames alone where there are any, and ratios of
        medians to the paper's.
    """
    for given, known in ((methods, METHODS), (joints, JOINTS), (densities, DENSITIES), (scenes, SCENES)):
        for name in given:
            if name not in known:
                raise UserError(f"unknown '{name}'{did_you_mean(name, known)}")
    generator, spec, methods = remembering(generator), generator.spec, methods or possible(generator)
    usable = usable_clips(data, spec, shortest)
    cases = [case for scene in scenes for case in _cases(usable, spec, clips, joints, densities, scene, seed)]
    chosen = ways(generator, cases, methods, engine.progress)
    return engine.run(
        [(f"{case.keyframes.joint} {case.density}", case) for case in cases],
        lambda case: _measured(generator, chosen, case),
        lambda rows: _summary(rows, methods, longest(spec)),
        {
            "bench": "control", "data": data, "clips": clips, "methods": methods, "joints": joints,
            "densities": densities, "scenes": scenes, "shortest": shortest, "seed": seed,
        },
    )  # fmt: skip


def _measured(generator: Generator, ways: Mapping[str, Way], case: Case) -> list[Row]:
    """A row for the sample without control and for each way."""
    free, scorer = case.keyframes.drafted(generator).motion, Scorer(case.scene)
    rows = [_row("uncontrolled", case, free, free, scorer) | {"seconds": 0.0, "refine_seconds": 0.0, "passes": 0}]
    for name, way in ways.items():
        began = time.perf_counter()
        made = way(case)
        cost = {"seconds": time.perf_counter() - began, "refine_seconds": made.seconds, "passes": made.passes}
        rows.append(_row(name, case, made.motion, made.unrefined, scorer) | cost)
    return rows


def _cases(
    usable: Sequence[Clip],
    spec: Spec,
    clips: int,
    joints: Sequence[str],
    densities: Sequence[str],
    scene: str,
    seed: int,
) -> Iterator[Case]:
    draw = torch.Generator().manual_seed(seed)
    place = _between_pillars if scene == "pillars" else _on_floor
    for joint in joints:
        for density in densities:
            for i in torch.randperm(len(usable), generator=draw)[:clips].tolist():
                asked = Keyframes.drawn(usable[i], spec, joint, DENSITIES[density], draw, seed + i)
                yield place(asked, density)


def _on_floor(asked: Keyframes, density: str) -> Case:
    return Case(asked, density, Scene.empty(FLOOR))


def _between_pillars(asked: Keyframes, density: str) -> Case:
    """Keyframes of a recording among pillars, which it passes at `NEAREST` to `FURTHEST`."""
    draw, way = torch.Generator().manual_seed(asked.seed), asked.real.joint("pelvis")[:, [0, 2]]
    found: list[Cylinder] = []
    for _ in range(TRIES):
        frame = int(torch.randint(len(way), (), generator=draw))
        x, z = (way[frame] + 0.6 * torch.randn(2, generator=draw)).tolist()
        pillar = Cylinder((x, HEIGHT / 2, z), RADIUS, HEIGHT)
        nearest = Scorer(Scene(primitives=(pillar,))).depths(asked.real).clearance.min()
        if NEAREST <= nearest <= FURTHEST:
            found.append(pillar)
        if len(found) == PILLARS:
            break
    return Case(asked, density, Scene(primitives=found, floor=FLOOR, name="pillars"), (_CLEAR,))


def _row(method: str, case: Case, motion: Motion, before: Motion, scorer: Scorer) -> Row:
    error, depths = case.keyframes.errors(motion), scorer.depths(motion[0])
    others = [j for j in range(len(HUMANML3D.names)) if HUMANML3D.names[j] != case.keyframes.joint]
    moved = (motion.joints - before.joints)[..., others, :].norm(dim=-1).mean()
    return {
        "method": method,
        "scene": case.scene.name,
        "joint": case.keyframes.joint,
        "density": case.density,
        "frames": motion.frames,
        "average_error_m": float(error.mean()),
        "location_error": float((error > FAILED).float().mean()),
        "trajectory_error": float((error > FAILED).any()),
        "deepest_penetration_m": float(depths.obstacles.max()),
        "deepest_floor_penetration_m": float(depths.floor.max()),
        "moved_m": float(moved),
        "max_acceleration_m_per_frame2": float(max_acceleration(motion[0])),
        "skating_ratio": float(skating_ratio(motion[0])),
    }


_MEDIANS = ("seconds", "refine_seconds", "passes")


def _summary(rows: Sequence[Row], methods: Sequence[str], most: int) -> dict[str, Any]:
    figures = [key for key, value in rows[0].items() if isinstance(value, float | int) and key != "frames"]
    found: dict[str, Any] = {"motions": sum(row["method"] == "uncontrolled" for row in rows)}
    for method in ("uncontrolled", *methods):
        mine = [row for row in rows if row["method"] == method]
        for key in figures:
            found[f"{method}_{key}"] = _middle(key, [row[key] for row in mine])
        for key in ("seconds", "refine_seconds"):  # timings are quoted for the longest motions
            if long := [row[key] for row in mine if row["frames"] == most]:
                found[f"{method}_{key}_at_{most}"] = statistics.median(long)
        for density in dict.fromkeys(row["density"] for row in mine):
            some = [row["average_error_m"] for row in mine if row["density"] == density]
            found[f"{method}_average_error_m_at_{density}"] = statistics.fmean(some)
    if {"paper", "scenectl"} <= set(methods):
        for key in _MEDIANS:
            found[f"paper_over_scenectl_{key}"] = found[f"paper_{key}"] / max(found[f"scenectl_{key}"], 1e-9)
    return found


def _middle(key: str, values: Sequence[float | int]) -> float:
    return float(statistics.median(values) if key in _MEDIANS else statistics.fmean(values))


def plot(result: Mapping[str, Any], png: str | Path) -> None:
    """Error against seconds, a point for each motion and method, to a picture."""
    from matplotlib.figure import Figure  # without pyplot, so that no window system is asked for

    figure = Figure(figsize=(8, 5), layout="constrained")
    axis = figure.subplots()
    for method in METHODS:
        mine = [row for row in result["rows"] if row["method"] == method]
        if mine:
            errors = [max(1000 * row["average_error_m"], 1e-3) for row in mine]
            axis.scatter([row["seconds"] for row in mine], errors, s=14, alpha=0.6, label=method)
    axis.set(xscale="log", yscale="log", xlabel="seconds, text encoding excluded", ylabel="average error, mm")
    axis.legend()
    axis.grid(alpha=0.3, which="both")
    with atomic_write(png) as file:
        figure.savefig(file, format=Path(png).suffix.lstrip(".") or "png", dpi=110)
