"""A patrol that goes on and on: one walk after the other through a scene, each from where the one before ended."""

from __future__ import annotations

import gc
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch

from scenectl.bench.control.rooms import DEEP, LONGEST_PATH, RADIUS, SHORTEST_PATH, TRIES, Room, room_of
from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.bench.studies.memory import resident
from scenectl.generators.base import Generator
from scenectl.measures.metrics import seam_ratio
from scenectl.pipeline.results import Result as Made
from scenectl.pipeline.run import run
from scenectl.tasks.schema import Start
from scenectl.tasks.task import Task
from scenes.errors import UserError
from scenes.motion.motion import Motion

LOST = 5.0
"""Seconds that a leg which cannot be planned counts for, so that a patrol ends."""
MISS = 0.15
"""Metres from a place, on the floor, within which a leg ends there."""


def bench_patrol(
    generator: Generator, scene: str | Path, minutes: float = 5.0, seed: int = 0, samples: int = 4,
    engine: Engine = ENGINE,
) -> Result:  # fmt: skip
    """Walk from place to place, each walk a task of its own that goes on from the one before (`Result.then`).

    Args:
        generator: one that can edit.
        scene: a scan or model in metres, y up, or a bundled scene.
        minutes: how long all of it lasts at least.
        seed: of places and motions.
        samples: motions made for each leg, of which the first-ranked goes on.
        engine: tells progress. A leg needs the one before, so that no rows are kept.

    Returns:
        ``{"summary", "rows"}``, a row for each leg; metres, seconds, MB (10^6 bytes) of memory in use.

    Raises:
        UserError: an unreadable scene, or one without space to walk.
    """
    rows = list(_legs(generator, room_of(scene), 60 * minutes, seed, samples, engine))
    return {"summary": _summary(rows), "rows": rows}


def _legs(generator: Generator, room: Room, seconds: float, seed: int, samples: int, engine: Engine) -> Iterator[Row]:
    rng = np.random.default_rng(seed)
    before: Made | None = None
    done, here = 0.0, _somewhere(room, rng)
    while done < seconds:
        number = round(done)
        engine.progress(f"{number} s of {seconds:g}", done / seconds)
        to = _next(room, here, rng)
        task = Task(actions=({"do": "walk", "to": list(to), "radius": RADIUS},), scene=room.scene)
        given: dict[str, Any] = {
            "samples": samples, "seed": seed + number, "generator": generator, "scorer": room.scorer,
        }  # fmt: skip
        try:
            if before is None:
                made = run(task.model_copy(update={"start": Start(position=here)}), **given)
            else:
                made = before.then(task, **given)
        except UserError as error:  # a leg that cannot be planned ends this patrol, and another begins
            yield {"seconds": 0.0, "good": False, "refused": str(error)}
            before, here, done = None, _somewhere(room, rng), done + LOST
            continue
        yield _row(made, before, to)
        before, done = made, done + made.motion.seconds
        x, z = made.motion.joint("pelvis")[0, -1, [0, 2]].tolist()
        here = (float(x), float(z))
        gc.collect()


def _somewhere(room: Room, rng: np.random.Generator) -> tuple[float, float]:
    x, z = room.area.sample(1, rng)[0].tolist()
    return float(x), float(z)


def _next(room: Room, here: tuple[float, float], rng: np.random.Generator) -> tuple[float, float]:
    """A place to walk to, as the crow flies so far away."""
    away = [(float(x), float(z)) for x, z in room.area.sample(TRIES, rng)]
    fit = [to for to in away if SHORTEST_PATH <= math.dist(here, to) <= LONGEST_PATH]
    if not fit:
        raise UserError(f"no place to walk to was found from [{here[0]:.2f}, {here[1]:.2f}] in '{room.name}'")
    return fit[0]


def _row(made: Made, before: Made | None, to: Sequence[float]) -> Row:
    best = made.samples[0]
    end = made.motion.joint("pelvis")[0, -1, [0, 2]]
    deepest = max(float(best.metrics[f"deepest_{what}penetration_m"] or 0.0) for what in ("", "floor_"))
    row: Row = {
        "seconds": made.motion.seconds,
        "good": best.good,
        "missed_m": float((end - end.new_tensor(list(to))).norm()),
        "deepest_m": deepest,
        "skating_ratio": best.metrics["skating_ratio"],
        "generate_s": made.report["timing"]["generate_s"],
        "resident_mb": resident(),
        "verdict": best.verdict.sentence,
    }
    if before is not None:
        one, two = before.motion.joints[0], made.motion.joints[0]
        row["gap_m"] = float((two[0] - one[-1]).norm(dim=-1).max())
        row["seam_ratio"] = seam_ratio(Motion(torch.cat([one, two]), fps=made.motion.fps), [len(one) / made.motion.fps])
    return row


def _summary(rows: Sequence[Row]) -> Row:
    made = [row for row in rows if "refused" not in row]
    if not made:
        raise UserError(f"no leg could be planned: {rows[0]['refused']}")
    tenth = math.ceil(len(made) / 10)
    first, last = made[:tenth], made[-tenth:]
    seams, gaps = ([row[name] for row in made if name in row] for name in ("seam_ratio", "gap_m"))
    return {
        "legs": len(made),
        "refused": len(rows) - len(made),
        "seconds": sum(row["seconds"] for row in made),
        "good_rate": float(np.mean([row["good"] for row in made])),
        "reached_rate": float(np.mean([row["missed_m"] <= MISS for row in made])),
        "worst_missed_m": max(row["missed_m"] for row in made),
        "clean_rate": float(np.mean([row["deepest_m"] <= DEEP for row in made])),
        "deepest_m": max(row["deepest_m"] for row in made),
        "median_seam_ratio": median(seams) if seams else None,
        "largest_gap_m": max(gaps, default=None),
        "median_generate_s": median(row["generate_s"] for row in made),
        "grew_mb": float(np.mean([r["resident_mb"] for r in last]) - np.mean([r["resident_mb"] for r in first])),
    }
