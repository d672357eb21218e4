"""Edits of a furnished room against baking it whole: seconds, and whether every bit is the same."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import Any, TypeAlias

import numpy as np

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenes.mesh.content import joined
from scenes.mesh.mesh import Mesh, load_parts
from scenes.sdf.bake import bake
from scenes.sdf.grid import SdfGrid
from scenes.world.assembly import Assembly
from scenes.world.scene import BUNDLED

Nudge: TypeAlias = tuple[float, np.ndarray]
"""A turn (rad) and a shift (m) over the floor."""


def bench_assembly(
    mesh: str | Path | None = None,
    resolution: int = 256,
    rounds: int = 5,
    seed: int = 0,
    engine: Engine = ENGINE,
) -> Result:
    """Move, remove and add objects of a scene, each time beside a full bake that must be equal bit for bit.

    Args:
        mesh: a file of named objects; default, the bundled living room.
        resolution: nodes along the longest side.
        rounds: moves, removals and additions, as many of each.
        seed: of which object is edited, and where it goes.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        Medians over the rounds in "summary", one row an edit. ``whole_s`` bakes all objects as one mesh, which is the
        fastest way to start anew; ``full_s`` bakes each and puts them together. Both and the edits take turns.
    """
    meshes = load_parts(BUNDLED / "living_room.glb" if mesh is None else mesh)
    scene = Assembly(meshes, resolution)
    longest = {name: float(np.ptp(part.bounds, axis=0).max()) for name, part in meshes.items()}
    movable = [name for name in meshes if longest[name] < max(longest.values()) / 2]
    rng = np.random.default_rng(seed)
    scene.move(movable[0], _nudged(scene, movable[0], _drawn(rng)))  # kernels are compiled
    cases = [(f"edit {name}", (name, _drawn(rng))) for name in (str(rng.choice(movable)) for _ in range(rounds))]

    def edited(case: tuple[str, Nudge]) -> list[Row]:
        name, nudge = case
        poses = {"move": _nudged(scene, name, nudge), "remove": np.eye(4), "add": np.eye(4)}
        return [_row(scene, what, name, pose, meshes, resolution) for what, pose in poses.items()]

    about = {
        "resolution": resolution,
        "objects": len(meshes),
        "triangles": sum(len(part.faces) for part in meshes.values()),
    }
    settings = {"bench": "edit", "mesh": mesh, "resolution": resolution, "rounds": rounds, "seed": seed}
    return engine.run(cases, edited, lambda rows: {**about, **_summary(rows)}, settings)


def _row(scene: Assembly, what: str, name: str, pose: np.ndarray, meshes: dict[str, Mesh], resolution: int) -> Row:
    """One edit, and what baking anew takes after it."""
    edit_s = _timed(lambda: _edited(scene, what, name, pose, meshes))[1]
    full, full_s = _timed(scene.full)
    placed = [scene.mesh(part) for part in scene.names]
    whole = Mesh(*joined([(part.vertices, part.faces) for part in placed]), "whole")
    whole_s = _timed(lambda: bake(whole, resolution, cache=None))[1]
    same = np.array_equal(_bits(full), _bits(scene))
    return {"edit": what, "object": name, "edit_s": edit_s, "full_s": full_s, "whole_s": whole_s, "equal": same}


def _summary(rows: Sequence[Row]) -> dict[str, Any]:
    return {
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


def _drawn(rng: np.random.Generator) -> Nudge:
    return rng.uniform(-math.pi, math.pi), rng.uniform(-0.5, 0.5, 3) * (1, 0, 1)


def _nudged(scene: Assembly, name: str, nudge: Nudge) -> np.ndarray:
    """Another pose: up to half a metre away and turned about its middle, upright."""
    angle, shift = nudge
    turn = np.eye(4)
    turn[0, 0] = turn[2, 2] = math.cos(angle)
    turn[0, 2], turn[2, 0] = math.sin(angle), -math.sin(angle)
    middle = scene.mesh(name).bounds.mean(axis=0)
    turn[:3, 3] = middle - turn[:3, :3] @ middle + shift
    pose: np.ndarray = turn @ scene.pose(name)
    return pose


def _bits(scene: Assembly) -> np.ndarray:
    bits: np.ndarray = scene.grid.values.numpy().view(np.int32)
    return bits
