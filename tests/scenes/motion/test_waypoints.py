"""Positions at times: straight lines between them, held at both ends."""

from __future__ import annotations

import torch

from scenes.mesh.primitives import Sphere
from scenes.motion.waypoints import Waypoints


def test_one_waypoint_is_a_place() -> None:
    sphere = Sphere((0, 0, 0), 1.0, Waypoints((2.0,), ((0, 3, 0),)))
    assert sphere.distance(torch.zeros(4, 3), torch.arange(4.0)).tolist() == [2.0] * 4


def test_between_waypoints_lines_are_straight_and_beyond_them_held() -> None:
    way = Waypoints((0.0, 2.0, 3.0), ((0, 0, 0), (4, 0, 0), (4, 1, 0)))
    times = torch.tensor([-1.0, 0.5, 2.0, 2.25, 9.0], dtype=torch.float64)
    expected = [[0, 0, 0], [1, 0, 0], [4, 0, 0], [4, 0.25, 0], [4, 1, 0]]
    torch.testing.assert_close(way.at(times), torch.tensor(expected, dtype=torch.float64))
