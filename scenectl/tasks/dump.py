"""Scenes and terms built in Python as the tables that would build them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel
from torch import Tensor

from objectives import Clip, Term
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import PRIMITIVES, Primitive
from scenes.motion.frames import HOME
from scenes.motion.motion import Motion
from scenes.sdf.bake import Bake
from scenes.sdf.grid import SdfGrid
from scenes.world.moving import MovingObject
from scenes.world.scene import BUNDLED, Scene


def scene_table(scene: Scene) -> dict[str, Any] | str:
    """A scene built in Python as the table that would build it; its name where its meshes are in no file."""
    scene = scene.seen_from(HOME)
    shapes = [_shape_table(shape) for shape in scene.primitives]
    objects = [_object_table(thing) for thing in scene.objects]
    if len(scene.meshes) > 1 or None in objects:
        return scene.name
    facts: dict[str, Any] = {"resolution": scene.baking.resolution, "primitives": shapes, "objects": objects}
    if scene.soft:
        facts["soft"] = dict(scene.soft)
    if not scene.meshes:
        return {**facts, "floor": scene.stated_floor}
    mesh = scene.meshes[0]
    if not Path(mesh.source).is_file():
        return scene.name
    voxels: dict[str, Any] = {"thickness": scene.baking.thickness} if scene.baking.thickness else {}
    if scene.baking.spacing is not None:
        voxels["spacing"] = scene.baking.spacing
    if Path(mesh.source).parent == BUNDLED:
        return {**facts, **voxels, "bundled": mesh.name}
    told = {"unit": mesh.unit, "up": mesh.up, "floor": scene.stated_floor, "free_space": scene.baking.free_space}
    return {**facts, "file": str(Path(mesh.source).resolve()), **voxels, **plain(told)}


def _object_table(thing: MovingObject) -> dict[str, Any] | None:
    """An object built in Python as the [[scene.objects]] table that would build it; None where it is in no file."""
    told = {"name": thing.name, **plain(asdict(thing.trajectory))}
    shape = thing.shape
    if isinstance(shape, Mesh):
        file = {"mesh": str(Path(shape.source).resolve()), "unit": shape.unit, "up": shape.up}
        return {**told, **file, "resolution": thing.resolution} if Path(shape.source).is_file() else None
    return None if isinstance(shape, Bake | SdfGrid) else {**told, "primitive": _shape_table(shape)}


def _shape_table(shape: Primitive) -> dict[str, Any]:
    name = next(name for name, kind in PRIMITIVES.items() if type(shape) is kind)
    return {"shape": name, **plain(asdict(shape))}


def term_table(term: Term) -> dict[str, Any]:
    """A term built in Python as the [[goal]] table that would build it."""
    keys = ("weight", "tolerance", "at", "weights", "window", "sometime", "kernel", "reduction", "delta", "name")
    options = {key: getattr(term, key) for key in keys if getattr(term, key) is not None}
    return {"use": term.goal, **plain(options), **plain(dict(term.parameters))}


def plain(value: Any) -> Any:
    """JSON values: models and motions as tables, arrays as lists, paths as text."""
    if isinstance(value, BaseModel):
        return plain({name: getattr(value, name) for name in type(value).model_fields})
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items() if item is not None}
    if isinstance(value, Motion):
        return plain(Clip.model_validate(value))
    if isinstance(value, np.ndarray | Tensor):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value
