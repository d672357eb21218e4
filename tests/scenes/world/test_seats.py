"""Seats: found on named parts and points of boxes, with the back to a backrest, and refused where nobody fits."""

from __future__ import annotations

import math

import pytest
import torch

from scenes.errors import UserError
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Box
from scenes.world.floor.planning import free_area
from scenes.world.scene import Scene
from scenes.world.seats import BEFORE, INSET, find_seat


def room(*boxes: tuple[str, tuple[float, float, float], tuple[float, float, float]]) -> Scene:
    """A floor and boxes by name, middle and size."""
    shapes = [("floor", (0.0, -0.1, 0.0), (8.0, 0.2, 8.0)), *boxes]
    meshes = [Box(middle, size).mesh() for _, middle, size in shapes]
    named = [Mesh(mesh.vertices, mesh.faces, name) for mesh, (name, *_) in zip(meshes, shapes, strict=True)]
    return Scene(named, resolution=96, cache=None)


SEAT = ("seat", (0.0, 0.225, 0.0), (0.5, 0.45, 0.5))
BACK = ("back", (0.0, 0.45, -0.3), (0.5, 0.9, 0.1))


def test_a_chair_faces_away_from_its_back() -> None:
    scene = room(SEAT, BACK)
    seat = find_seat(scene, free_area(scene), "seat", near=(0.0, 0.0, -3.0))
    assert seat.backed and seat.heading == pytest.approx(0.0) and seat.height == pytest.approx(0.45, abs=0.01)
    assert seat.hips == pytest.approx((0.0, 0.45, 0.25 - INSET), abs=0.04)
    assert seat.stand == pytest.approx((0.0, 0.0, 0.25 + BEFORE), abs=0.04)


def test_a_stool_is_sat_on_from_where_one_comes() -> None:
    scene = room(SEAT)
    for x, z in ((2.0, 0.0), (0.0, 2.0), (-2.0, 0.0)):
        seat = find_seat(scene, free_area(scene), (0.0, 0.45, 0.0), near=(x, 0.0, z))
        assert (math.sin(seat.heading), math.cos(seat.heading)) == pytest.approx((x / 2, z / 2)) and not seat.backed


def test_a_stated_heading_is_kept() -> None:
    scene = room(SEAT)
    assert find_seat(scene, free_area(scene), "seat", (0.0, 0.0, 2.0), heading=math.pi / 2).heading == math.pi / 2
    with pytest.raises(UserError, match="nobody can sit on 'seat': no side of it has room"):
        find_seat(room(SEAT, BACK), free_area(room(SEAT, BACK)), "seat", (0.0, 0.0, 2.0), heading=math.pi)


def test_a_seat_that_is_walled_in_is_none() -> None:
    walls = [
        (f"wall {k}", (1.0 * x, 0.6, 1.0 * z), (1.5 if z else 0.1, 1.2, 1.5 if x else 0.1))
        for k, (x, z) in enumerate([(0.45, 0), (-0.45, 0), (0, 0.45), (0, -0.45)])
    ]
    scene = room(SEAT, *walls)  # type: ignore[arg-type]
    with pytest.raises(UserError, match="nobody can sit on 'seat'"):
        find_seat(scene, free_area(scene), "seat", (0.0, 0.0, 2.0))


def test_parts_have_names_and_distances() -> None:
    scene = room(SEAT, BACK)
    assert list(scene.named) == ["floor", "seat", "back"]
    over = scene.part("seat").distance(torch.tensor([[0.0, 0.75, 0.0]]))
    assert float(over) == pytest.approx(0.3, abs=0.02)
    with pytest.raises(UserError, match="has no part 'sear'; did you mean 'seat'"):
        scene.part("sear")
