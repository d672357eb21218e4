"""Bakes against the oracle: distance error near the surface, signs, impossible flips, seconds."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scenectl.generators.base import Progress
from scenes.accuracy import measure
from scenes.bake import bake
from scenes.mesh import Mesh, load_mesh
from scenes.scene import bundled, bundled_names


def bench_bake(
    meshes: Sequence[str | Path] = (), resolution: int = 256, progress: Progress | None = None
) -> dict[str, Any]:
    """Bake each mesh afresh (no cache) and compare with libigl; the bundled scenes where none is named."""
    tell = progress or (lambda what, done: None)
    given: list[Mesh] = [load_mesh(path) for path in meshes]
    if not given:
        given = [mesh for name in bundled_names() for mesh in bundled(name).meshes]
    rows: list[dict[str, Any]] = []
    for i, mesh in enumerate(given):
        tell(f"baking {mesh.name}", i / len(given))
        began = time.perf_counter()
        result = bake(mesh, resolution, cache=None)
        seconds = time.perf_counter() - began
        rows.append(
            {
                "mesh": mesh.name,
                "triangles": len(mesh.faces),
                "closed": result.closed,
                "rule": result.rule,
                "wall_s": seconds,
                **measure(result, mesh).row(),
            }
        )
    summary = {
        "resolution": resolution,
        "near_error_voxels": max(row["near_error_voxels"] for row in rows),
        "sign_errors_closed": sum(row["sign_errors"] for row in rows if row["closed"]),
        "impossible_flips_closed": sum(row["impossible_flips"] for row in rows if row["closed"]),
    }
    return {"summary": summary, "rows": rows}
