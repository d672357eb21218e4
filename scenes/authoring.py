"""Solids for scenes that a script makes, such as ``examples/make_cart.py``; metres, y up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from manifold3d import Manifold, OpType

from scenes.mesh import glb as files
from scenes.mesh.glb import Item as Item


@dataclass(frozen=True)
class Plan:
    """A scene, as scripts stated it before bundled scenes were data; `glb` writes its `items`.

    `start` is (x, z, heading in rad); `targets` are floor positions (x, z) and `reach` are points (x, y, z).
    """

    name: str
    notes: str
    items: tuple[Item, ...]
    start: tuple[float, float, float]
    targets: dict[str, tuple[float, float]]
    reach: dict[str, tuple[float, float, float]] = field(default_factory=dict)


def box(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Manifold:
    """Box between two coordinates (m) along each axis."""
    return Manifold.cube((x[1] - x[0], y[1] - y[0], z[1] - z[0])).translate((x[0], y[0], z[0]))


def join(*parts: Manifold) -> Manifold:
    """Union of solids."""
    return Manifold.batch_boolean(list(parts), OpType.Add)


def glb(scene: Plan | Sequence[Item]) -> bytes:
    """Bytes of a binary glTF file (`scenes.mesh.glb`) with a node for each object."""
    return files.glb(scene.items if isinstance(scene, Plan) else scene)
