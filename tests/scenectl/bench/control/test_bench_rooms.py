"""Walks through rooms: what is asked of a person can be stood and walked."""

from __future__ import annotations

import numpy as np
import pytest

from scenectl.bench.control.rooms import _room, _tasks
from scenectl.control import SolverSettings


@pytest.mark.parametrize("seed", [1, 2])
def test_walks_begin_where_a_person_stands_upright(seed: int) -> None:
    room = _room("corridor", 0.35)  # seeds with which starts were drawn under the beam
    tasks = list(_tasks(room, 34, seed, 0.35, SolverSettings()))
    assert len(tasks) == 34 and room.rejected["no room to stand at the start"] > 0
    for task in tasks:
        assert np.isfinite(task.build(seed, scene=room.scene).seconds)
