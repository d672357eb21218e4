"""The bundled scenes are closed solids, small, the same every time, and as roomy as their notes say."""

from __future__ import annotations

import runpy
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenes.mesh.mesh import load_mesh
from scenes.world.floor.planning import FreeArea, free_area
from scenes.world.floor.polyline import path_length
from scenes.world.scene import BUNDLED, Scene, bundled, bundled_names

MAKE = runpy.run_path(str(BUNDLED / "make.py"), run_name="make")
items, write = MAKE["items"], MAKE["write"]
NAMES = sorted(path.stem for path in (BUNDLED / "solids").glob("*.toml"))


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Scene]:
    cache = tmp_path_factory.mktemp("bakes")
    return {name: bundled(name, resolution=64, cache=cache) for name in NAMES}


@pytest.fixture(scope="module")
def areas(scenes: dict[str, Scene]) -> dict[str, FreeArea]:
    return {name: free_area(scene, height=1.4 if name == "corridor" else 1.8) for name, scene in scenes.items()}


def facts(name: str) -> dict[str, Any]:
    return tomllib.loads((BUNDLED / f"{name}.toml").read_text(encoding="utf-8"))


def plan(name: str) -> dict[str, Any]:
    return facts(f"solids/{name}")


def test_every_scene_is_bundled() -> None:
    assert bundled_names() == NAMES


def test_the_script_writes_the_same_bytes_every_time_and_they_are_what_is_bundled(tmp_path: Path) -> None:
    first, again = write(tmp_path / "a"), write(tmp_path / "b")
    for one, two in zip(first, again, strict=True):
        assert one.read_bytes() == two.read_bytes()
        # other versions of the libraries may order bytes differently, but never move the furniture
        ours, theirs = load_mesh(one), load_mesh(BUNDLED / one.name)
        assert len(ours.faces) == len(theirs.faces)
        assert np.allclose(ours.bounds, theirs.bounds, atol=1e-5)


@pytest.mark.parametrize("name", NAMES)
def test_every_object_is_a_closed_solid_with_a_name_and_a_colour(name: str) -> None:
    import trimesh

    path = BUNDLED / f"{name}.glb"
    assert path.stat().st_size < 100_000
    whole = trimesh.load(path)
    nodes = list(whole.graph.nodes_geometry)
    assert len(nodes) == len(list(items(plan(name)))) and "floor" in nodes
    for node in nodes:
        transform, geometry = whole.graph[node]
        shape = whole.geometry[geometry]
        assert np.allclose(transform, np.eye(4))
        assert shape.is_watertight and shape.is_winding_consistent and shape.volume > 0, node
        assert shape.visual.material.baseColorFactor is not None


@pytest.mark.parametrize("name", NAMES)
def test_the_floor_is_where_the_notes_say(name: str, scenes: dict[str, Scene]) -> None:
    stated = facts(name)
    assert stated["unit"] == "m" and stated["up"] == "y" and stated["notes"]
    assert scenes[name].floor.height == stated["floor"]
    assert scenes[name].floors[0].height == pytest.approx(scenes[name].floor.height, abs=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_every_target_can_be_walked_to(name: str, areas: dict[str, FreeArea]) -> None:
    stated = facts(name)
    start = stated["start"]["position"]
    for goal in stated["targets"].values():
        path = areas[name].path(start, goal)
        assert np.linalg.norm(np.subtract(start, goal)) - 1e-6 <= path_length(path) < 10.0


def test_the_living_room_has_wide_ways_between_door_window_and_shelf(areas: dict[str, FreeArea]) -> None:
    stated = facts("living_room")
    door, window, shelf = stated["start"]["position"], stated["targets"]["window"], stated["targets"]["shelf"]
    for a, b in ((door, window), (door, shelf), (window, shelf)):
        assert areas["living_room"].widest(a, b) >= 0.45


def test_under_the_beam_one_must_duck(scenes: dict[str, Scene]) -> None:
    below = np.array([[0.0, 1.0, 0.0], [0.0, 1.45, 0.1], [0.6, 1.6, 0.0]])
    assert scenes["corridor"].distance_exact(below) == pytest.approx([0.45, 0.0, -0.15], abs=1e-6)


def test_the_doorway_is_90_cm_wide(scenes: dict[str, Scene], areas: dict[str, FreeArea]) -> None:
    assert scenes["doorway"].distance_exact(np.array([[0.0, 1.0, 0.0]])) == pytest.approx([0.45], abs=1e-6)
    widest = areas["doorway"].widest((0.8, -2.2), (0.6, 2.4))
    assert 0.4 <= widest <= 0.45  # cells of 5 cm straddle the middle


def test_the_steps_rise_by_16_cm(scenes: dict[str, Scene]) -> None:
    on_top = np.array([[0.0, 0.16 * k, z] for k, z in ((1, -0.15), (2, -0.45), (3, -0.75), (3, -2.0))])
    assert scenes["stairs"].distance_exact(on_top) == pytest.approx(np.zeros(4), abs=1e-6)


def test_the_slalom_leaves_a_metre_between_pillars(scenes: dict[str, Scene]) -> None:
    between = np.array([[0.0, 1.0, -1.6], [0.0, 1.0, 0.0], [0.0, 1.0, 1.6]])
    assert scenes["pillars"].distance_exact(between) == pytest.approx(np.full(3, 0.5), abs=2e-3)
