"""Edits of a furnished room against baking it whole: seconds, and whether every bit is the same."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from scenectl.generators.base import Progress
from scenes.mesh.mesh import Mesh, joined, load_parts
from scenes.sdf.bake import bake
from scenes.sdf.grid import SdfGrid
from scenes.world.assembly import Assembly
from scenes.world.scene import BUNDLED


def bench_edit(
    mesh: str | Path | None = None,
    resolution: int = 256,
    rounds: int = 5,
    seed: int = 0,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Move, remove and add objects of a scene, each time beside a full bake that must be equal bit for bit.

    Args:
        mesh: a file of named objects; default, the bundled living room.
        resolution: nodes along the longest side.
        rounds: moves, removals and additions, as many of each.
        seed: of which object is edited, and where it goes.
        progress: called with what is done and which share of the work that is.

    Returns:
        Medians over the rounds in "summary", one row an edit. ``whole_s`` bakes all objects as one mesh, which is the
        fastest way to start anew; ``full_s`` bakes each and puts them together. Both and the edits take turns.
    """
    tell = progress or (lambda what, done: None)
    meshes = load_parts(BUNDLED / "living_room.glb" if mesh is None else mesh)
    scene = Assembly(meshes, resolution)
    longest = {name: float(np.ptp(part.bounds, axis=0).max()) for name, part in meshes.items()}
    movable = [name for name in meshes if longest[name] < max(longest.values()) / 2]
    rng = np.random.default_rng(seed)
    rows: list[dict[str, Any]] = []
    scene.move(movable[0], _nudged(scene, movable[0], rng))  # kernels are compiled
    for round_ in range(rounds):
        name = str(rng.choice(movable))
        for what in ("move", "remove", "add"):
            tell(f"{what} {name}", round_ / rounds)
            pose = _nudged(scene, name, rng) if what == "move" else np.eye(4)
            edit_s = _timed(lambda: _edited(scene, what, name, pose, meshes))[1]  # noqa: B023  # called at once
            full, full_s = _timed(scene.full)
            placed = [scene.mesh(part) for part in scene.names]
            whole = Mesh(*joined([(part.vertices, part.faces) for part in placed]), "whole")
            whole_s = _timed(lambda: bake(whole, resolution, cache=None))[1]  # noqa: B023
            same = np.array_equal(_bits(full), _bits(scene))
            rows.append(
                {"edit": what, "object": name, "edit_s": edit_s, "full_s": full_s, "whole_s": whole_s, "equal": same}
            )
    summary: dict[str, Any] = {
        "resolution": resolution,
        "objects": len(meshes),
        "triangles": sum(len(part.faces) for part in meshes.values()),
        **{
            f"{what}_s": median(row["edit_s"] for row in rows if row["edit"] == what)
            for what in ("move", "add", "remove")
        },
        "full_s": median(row["full_s"] for row in rows),
        "whole_s": median(row["whole_s"] for row in rows),
        "full_over_edit": median(row["full_s"] / row["edit_s"] for row in rows),
        "whole_over_edit": median(row["whole_s"] / row["edit_s"] for row in rows),
        "all_equal": all(row["equal"] for row in rows),
    }
    return {"summary": summary, "rows": rows}


def _edited(scene: Assembly, what: str, name: str, pose: np.ndarray, meshes: dict[str, Mesh]) -> SdfGrid:
    """The grid after an edit."""
    if what == "move":
        scene.move(name, pose)
    elif what == "remove":
        scene.remove(name)
    else:
        scene.add(name, meshes[name], pose)
    return scene.grid


def _timed(work: Callable[[], Any]) -> tuple[Any, float]:
    began = time.perf_counter()
    result = work()
    return result, time.perf_counter() - began


def _nudged(scene: Assembly, name: str, rng: np.random.Generator) -> np.ndarray:
    """Another pose: up to half a metre away and turned about its middle, upright."""
    angle = rng.uniform(-math.pi, math.pi)
    turn = np.eye(4)
    turn[0, 0] = turn[2, 2] = math.cos(angle)
    turn[0, 2], turn[2, 0] = math.sin(angle), -math.sin(angle)
    middle = scene.mesh(name).bounds.mean(axis=0)
    turn[:3, 3] = middle - turn[:3, :3] @ middle + rng.uniform(-0.5, 0.5, 3) * (1, 0, 1)
    pose: np.ndarray = turn @ scene.pose(name)
    return pose


def _bits(scene: Assembly) -> np.ndarray:
    bits: np.ndarray = scene.grid.values.numpy().view(np.int32)
    return bits
