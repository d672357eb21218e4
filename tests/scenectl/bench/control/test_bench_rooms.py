"""Walks through rooms: what is asked of a person can be stood and walked."""

from __future__ import annotations

from collections import Counter
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from scenectl.bench.control.rooms import Room, _stopped, room_of, walks_in
from scenectl.bench.scenes.meshes import FACINGS
from scenectl.control import SolverSettings
from scenectl.measures.metrics import Scorer
from scenes.errors import UserError
from scenes.mesh.primitives import Box
from scenes.motion.motion import Motion
from scenes.world.floor.planning import free_area
from scenes.world.scene import Scene
from tests.objectives.cases import standing


@pytest.mark.parametrize("seed", [1, 2])
def test_walks_begin_where_a_person_stands_upright(seed: int) -> None:
    room = room_of("corridor", 0.35)  # seeds with which starts were drawn under the beam
    tasks = list(walks_in(room, 34, seed, 0.35, SolverSettings()))
    assert len(tasks) == 34 and room.rejected["no room to stand at the start"] > 0
    for task in tasks:
        assert np.isfinite(task.build(seed, scene=room.scene).seconds)


class Closet(Scene):
    """2 x 1.4 m between walls: with a radius of 0.5 m one gets 1 m along its middle."""

    def __init__(self) -> None:
        walls = [Box((s * 1.05, 1.0, 0.0), (0.1, 2.0, 1.6)) for s in (-1, 1)]
        walls += [Box((0.0, 1.0, s * 0.75), (2.2, 2.0, 0.1)) for s in (-1, 1)]
        super().__init__(primitives=walls, floor=0.0, name="closet")

    @cached_property
    def bounds(self) -> np.ndarray:  # type: ignore[override]
        return np.array([[-1.1, 0.0, -0.8], [1.1, 2.0, 0.8]])


def test_a_room_too_small_to_walk_in_says_how_far_one_gets_and_what_radius_would_do() -> None:
    scene = Closet()
    area = free_area(scene, 0.6)
    room = Room("closet", scene, area, area, Scorer(scene), 1.8, "x", Counter())
    with pytest.raises(UserError, match=r"the longest way found is 0.[78]\d m as .* a radius of 0.5[0-3] m would do"):
        list(walks_in(room, 1, 0, 0.6, SolverSettings()))
    assert list(walks_in(room, 1, 0, 0.45, SolverSettings()))


def test_a_room_is_the_same_in_every_winding(tmp_path: Path) -> None:
    dent = trimesh.creation.box(bounds=[[1, 0, 1], [3.2, 0.7, 2.6]])
    whole = trimesh.boolean.difference([trimesh.creation.box(bounds=[[0, 0, 0], [5, 2.6, 4]]), dent], engine="manifold")
    whole.invert()
    whole.export(tmp_path / "room.ply")
    areas = [room_of(tmp_path / "room.ply", 0.3, facing).area.square_metres for facing in FACINGS]
    assert np.ptp(areas) < 0.02 * areas[0]
    with pytest.raises(UserError, match="did you mean 'reversed'"):
        room_of(tmp_path / "room.ply", 0.3, "revresed")


@pytest.mark.parametrize(
    ("speed", "frames", "high", "stopped"),
    [(0.15, 9, 0.0, True), (0.25, 9, 0.0, False), (1.0, 3, 0.0, False), (0.0, 9, 0.1, False), (0.0, 9, 0.03, True)],
)
def test_a_walk_has_stopped_that_rests_on_both_feet(speed: float, frames: int, high: float, stopped: bool) -> None:
    """It moves at a speed in the last so many frames, with one foot so high at the very end."""
    joints = standing(40).float()
    joints[..., 2] += (torch.arange(40) - 39).clamp_min(-frames)[:, None] * speed / 20.0
    scorer = Scorer(Scene.empty())
    lowest = float(joints[0, [10, 11], 1].min())
    joints[..., 1] += scorer.body.sole_offset - lowest
    joints[-1, 10, 1] += high
    assert _stopped(Motion(joints, fps=20.0), scorer) == stopped


def test_walks_have_what_tasks_have_by_default() -> None:
    room = room_of("pillars", 0.35)
    for stop in (True, False):
        (task,) = walks_in(room, 1, 0, 0.35, SolverSettings(), stop)
        names = [term.name for term in task.build(0, scene=room.scene).objective.terms]
        assert names[-2:] == ["sdf_penetration", "foot_contact"] and ("walk: stop" in names) == stop
