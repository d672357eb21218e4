"""Following a path: distances to polylines, schedules, and that descending the cost brings a walker onto it."""

from __future__ import annotations

import math

import pytest
import torch

from objectives import Objective, Term
from objectives.library.paths import path_distance, path_height, path_point
from scenes.errors import UserError
from scenes.motion.motion import Motion
from tests.objectives.cases import context, standing

BEND = [[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.5, 1.0]]


def polyline() -> torch.Tensor:
    return torch.tensor(BEND, dtype=torch.float64)


def test_distance_is_that_to_the_nearest_point() -> None:
    points = 3 * torch.rand(200, 2, dtype=torch.float64) - 1
    dense = path_point(polyline(), torch.linspace(0, 1, 4001, dtype=torch.float64))
    exact = torch.cdist(points, dense).min(-1).values
    found = path_distance(points, polyline())
    far = exact > 0.1
    assert (found <= exact + 1e-9).all() and (exact - found)[far].max() < 0.005


def test_many_short_segments_change_little() -> None:
    fine = path_point(polyline(), torch.linspace(0, 1, 120, dtype=torch.float64))
    points = torch.tensor([[0.3, 0.4], [0.3, 0.7], [-0.3, 1.3], [1.2, 0.7]], dtype=torch.float64)
    assert (path_distance(points, polyline()) - path_distance(points, fine)).abs().max() < 0.01


def test_gradient_turns_smoothly_where_two_segments_are_equally_near() -> None:
    """Across the bisector of the corner the gradient turns without a jump, and never exceeds length 1."""
    offsets = torch.linspace(-0.02, 0.02, 401, dtype=torch.float64)
    points = torch.stack([0.4 + offsets, 0.6 + offsets], dim=-1).requires_grad_()  # crosses x = 1 - z at (0.4, 0.6)
    (gradient,) = torch.autograd.grad(path_distance(points, polyline()).sum(), points)
    steps = (gradient[1:] - gradient[:-1]).norm(dim=-1)
    turned = (gradient[-1] - gradient[0]).norm()
    assert turned > 1.0 and steps.max() < 0.05 * turned
    assert gradient.norm(dim=-1).max() < 1.0 + 0.02


def test_points_at_shares_of_the_length() -> None:
    shares = torch.tensor([0, 0.2, 0.4, 0.8, 1.0], dtype=torch.float64)
    expected = [[0, 0], [0, 0.5], [0, 1], [1, 1], [1.5, 1]]
    assert torch.allclose(path_point(polyline(), shares), torch.tensor(expected, dtype=torch.float64))


def walker(route: torch.Tensor, t0: float = 0.0) -> Motion:
    """A standing person moved so that the pelvis is at `route` [T, 2]."""
    joints = standing(len(route))
    move = torch.zeros(len(route), 1, 3, dtype=torch.float64)
    move[:, 0, ::2] = route - joints[:, 0, ::2]
    return Motion(joints + move, t0=t0)


def test_on_schedule_costs_nothing_and_waiting_does() -> None:
    path = [[x, 5.0, z] for x, z in BEND]  # heights are not used
    term = Term("follow_path", {"path": path, "begin": 1.0, "end": 3.0, "lag": 0.2, "half_width": 0.1})
    on_time = walker(path_point(polyline(), torch.linspace(0, 1, 41, dtype=torch.float64)), t0=1.0)
    assert float(term.cost(on_time, context())) == 0
    waiting = walker(polyline()[:1].expand(41, 2), t0=1.0)
    report = term.report(waiting, context())[0]
    assert report.where == "pelvis (schedule)" and report.when == pytest.approx(3.0)
    assert report.worst == pytest.approx(math.hypot(1.5, 1.0) - 0.2)


def test_easing_starts_and_stops_slowly() -> None:
    """At a quarter of the time the eased schedule has done 3 u^2 - 2 u^3 of the way, and half of it halfway."""
    term = Term("follow_path", {"path": [[0, 0], [0, 4]], "begin": 0, "end": 2, "lag": 0.1, "pace": "ease"})
    u = torch.linspace(0, 1, 41, dtype=torch.float64)
    assert float(term.cost(walker(torch.stack([0 * u, 4 * (3 * u**2 - 2 * u**3)], dim=-1)), context())) == 0
    steady = term.evaluate(walker(torch.stack([0 * u, 4 * u], dim=-1)), context()).residual[:, 2]
    assert float(steady[10]) == pytest.approx(4 * (0.25 - 0.15625) - 0.1) and float(steady[20]) == 0


def test_descending_brings_a_walker_into_the_corridor() -> None:
    """A straight walk across the corner's inside is pushed around it, and arrives."""
    term = Term("follow_path", {"path": BEND, "half_width": 0.1, "begin": 0.0, "end": 2.0, "lag": 0.1})
    start = walker(torch.lerp(polyline()[:1], polyline()[-1:], torch.linspace(0, 1, 41, dtype=torch.float64)[:, None]))
    moves = torch.zeros(41, 1, 3, dtype=torch.float64, requires_grad=True)
    objective, optimizer = Objective((term,)), torch.optim.LBFGS([moves], max_iter=60, line_search_fn="strong_wolfe")

    def closure() -> torch.Tensor:
        optimizer.zero_grad()
        cost = objective.cost(Motion(start.joints + moves), context())
        cost.backward()
        return cost

    before = float(closure().detach())
    optimizer.step(closure)
    report = objective.report(Motion((start.joints + moves).detach()), context())[0][0]
    assert before > 0.1 and report.worst < 0.01


def rising() -> torch.Tensor:
    """`BEND` with heights: level, up by a metre over the second part, level."""
    return torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0], [1.5, 1.0, 1.0]], dtype=torch.float64)


def test_the_height_of_a_path_is_that_at_its_nearest_point() -> None:
    points = torch.tensor([[0.05, 0.2], [0.5, 1.1], [0.8, 0.95], [1.4, 1.3]], dtype=torch.float64)
    assert path_height(points, rising(), None).tolist() == pytest.approx([0.0, 0.5, 0.8, 1.0], abs=0.03)


def test_of_winding_stairs_the_turn_counts_that_is_passed_by_then() -> None:
    angle = torch.linspace(0, 4 * math.pi, 81, dtype=torch.float64)
    stairs = torch.stack([angle.sin(), 0.2 * angle, angle.cos()], dim=-1)
    share = torch.linspace(0, 1, 81, dtype=torch.float64)
    assert torch.allclose(path_height(stairs[:, ::2], stairs, share), stairs[:, 1], atol=0.15)
    unclear = path_height(stairs[:, ::2], stairs, None)
    assert float((unclear - stairs[:, 1]).abs().max()) > 1.0  # a mean of both turns


def test_a_height_over_the_path_is_held() -> None:
    route = path_point(rising()[:, ::2], torch.linspace(0, 1, 41, dtype=torch.float64))
    flat = walker(route)
    hip = float(flat.joint("pelvis")[0, 1])
    path, times = rising().tolist(), {"begin": 0.0, "end": 2.0}
    term = Term("follow_path", {"path": path, "height": hip, **times})
    climbing = Motion(flat.joints + path_height(route, rising(), None)[:, None, None] * torch.tensor([0.0, 1.0, 0.0]))
    assert float(term.cost(climbing, context())) < 1e-6
    report = term.report(flat, context())[0]
    assert report.where == "pelvis (height)" and report.worst == pytest.approx(0.9, abs=0.01)  # a metre, less 0.1
    assert float(Term("follow_path", {"path": path, "height": hip}).cost(flat, context())) > 0.1  # without a schedule
    with pytest.raises(UserError, match=r"needs a path of \[x, y, z\]"):
        Term("follow_path", {"path": BEND, "height": hip}).cost(flat, context())


@pytest.mark.parametrize("brake", [0.0, 0.5, 2.0, 9.0])
def test_a_schedule_that_brakes_slows_down_evenly_to_a_halt(brake: float) -> None:
    length, frames, fps = 4.0, 41, 20.0
    term = Term("follow_path", {"path": [[0.0, 0.0], [0.0, length]], "begin": 0.0, "end": 2.0, "brake": brake})
    found = term.evaluate(Motion(standing(frames), fps=fps), context())
    assert found.targets is not None
    z = found.targets[:, 1, 2]
    speed = z.diff() * fps
    assert float(z[0]) == pytest.approx(0.0, abs=1e-9) and float(z[-1]) == pytest.approx(length)
    slow = min(brake, 2.0)
    assert float(speed[0]) == pytest.approx(length / (2.0 - slow / 2), rel=0.03)  # the mean of the first frame
    even = speed[: round((2.0 - slow) * fps)]
    assert not len(even) or float(even.max() - even.min()) < 1e-6
    if brake:
        falls = speed[round((2.0 - slow) * fps) :].diff()
        assert float(speed[-1]) < 0.15 * float(speed[0]) and float(falls.max() - falls.min()) < 1e-6
