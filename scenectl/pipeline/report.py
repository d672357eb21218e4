"""What happened, for report.json: metres, seconds and radians throughout."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch

from scenectl.pipeline.results import Sample, plain_json
from scenectl.pipeline.tables import FORMAT
from scenectl.tasks.setup import Setup
from scenectl.version import __version__
from scenes.world.floor.polyline import walked


def report_of(setup: Setup, rows: list[Sample], fps: float, threads: int) -> dict[str, Any]:
    """What happened, for JSON: metres, seconds and radians throughout, in world coordinates.

    `threads` is how many torch computed with.
    """
    scene, body, origin = setup.scene, setup.body, setup.origin
    start, path = setup.start.moved(origin), setup.path
    return {
        "format": FORMAT,
        "scenectl": __version__,
        "prompt": str(setup.prompts),
        "seconds": setup.seconds,
        "fps": fps,
        "start": {"position": list(start.position), "heading": start.heading},
        "walk": None
        if path is None
        else {"path": plain_json((path + np.array(origin)).round(4)), "length_m": walked(path)},
        "scene": {
            "name": scene.name,
            "digest": scene.digest,
            "floor_m": scene.floor.height + origin[1],
            "floor_found": scene.floor.found,
            "bake": scene.report(),
            "doubts": list(setup.doubts),
        },
        "body": {
            "source": body.source,
            "height_m": round(body.height, 3),
            "legs": round(body.size, 4),
            "sole_offset_m": body.sole_offset,
            "radii": body.table(),
        },
        "samples": [_row(rank, row) for rank, row in enumerate(rows)],
        "task": plain_json(setup.task.dump()),
        "machine": {"threads": threads, "instruction_set": torch.backends.cpu.get_cpu_capability()},
    }


def _row(rank: int, row: Sample) -> dict[str, Any]:
    return {
        "rank": rank,
        "sample": row.index,
        "cost": row.cost,
        "unrefined_cost": row.unrefined_cost,
        "pose_change_m": row.pose_change,
        "met": row.met,
        "believable": row.believable,
        "diagnosis": row.diagnosis,
        "verdict": plain_json(row.verdict.as_dict()),
        "start": row.start and {"position": list(row.start.position), "heading": row.start.heading},
        "terms": [term.as_dict() for term in row.terms],
        "metrics": plain_json(row.metrics),
        "series": _rounded({**row.series, "residuals": {term.name: term.series for term in row.terms}}),
    }


def _rounded(value: Any) -> Any:
    """Numbers to a tenth of a millimetre, of which there are many; None for those that are not finite; words as are."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    if isinstance(value, float):
        return round(value, 4) if math.isfinite(value) else None
    return value
