"""Parts of a motion: windows know where they begin, make all that is missing, and goals see the whole motion."""

from __future__ import annotations

from dataclasses import replace

import torch
from hypothesis import given, settings, strategies as st

from scenectl.generators.steps import DecodedStep
from scenectl.pipeline.parts import CONTEXT, PartStep, Window, windows_over
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid
from tests.scenectl.small import walk

LENGTH = 196


@settings(max_examples=200, deadline=None)
@given(
    total=st.integers(LENGTH // 2, 1200),
    edges=st.lists(st.integers(0, 1200), min_size=1, max_size=7),
    first=st.booleans(),
)
def test_windows_make_everything_once_and_know_where_they_begin(total: int, edges: list[int], first: bool) -> None:
    gone = torch.zeros(total, dtype=torch.bool)
    for k, edge in enumerate(sorted(edges)):
        gone[edge:] = (k % 2 == 0) != first
    if gone.all() or not gone.any():
        return
    made = torch.zeros(total, dtype=torch.int)
    for window in windows_over(gone, LENGTH):
        span = slice(window.start, window.end)
        assert window.start >= 0 and window.end <= total and window.end - window.start == min(LENGTH, total)
        assert torch.equal(window.inside, gone[span] & (made[span] == 0))
        assert window.taken.any() and not window.inside.all() and not (window.taken & ~window.inside).any()
        made[span] += window.taken
        if window.end < total and window.inside[-1]:  # what goes on is not settled where it is cut
            assert not window.taken[-1]
            assert not window.inside[:CONTEXT].any() or window.start == 0 or not window.taken[: CONTEXT // 2].any()
    assert torch.equal(made, gone.int())


def test_a_gap_that_goes_on_leads_to_its_end() -> None:
    gone = torch.zeros(800, dtype=torch.bool)
    gone[100:700] = True
    joints = torch.zeros(800, 22, 3)
    joints[:, 0, 2] = torch.arange(800.0)
    for window in windows_over(gone, LENGTH):
        toward = window.toward(Motion(joints))
        assert (toward is None) == (window.end > 700)
        if toward is not None:
            torch.testing.assert_close(toward, torch.tensor([0.0, window.end - 1.0]))


def test_a_step_of_a_part_is_one_of_the_whole() -> None:
    whole, inside = Motion(walk(50)), torch.zeros(20, dtype=torch.bool)
    inside[5:15] = True
    window = Window(10, 30, inside, inside)
    base = rigid(Motion(walk(20))).joints
    inner = DecodedStep(torch.randn(2, 20, 1, 3), lambda value: Motion(base + 2 * value))  # bones stay as they are
    step = PartStep(inner, whole, window)
    seen = step.motion.joints
    torch.testing.assert_close(seen[:, 15:25], (base + 2 * inner.value)[:, 5:15])
    torch.testing.assert_close(seen[:, 25:], whole.joints[25:].expand(2, -1, -1, -1))
    tangent, cotangent = torch.randn_like(inner.value), torch.randn_like(seen)
    pushed, pulled = step.jvp(tangent), step.vjp(cotangent)
    torch.testing.assert_close((pushed * cotangent).sum(), (pulled * tangent).sum(), rtol=1e-4, atol=1e-3)
    torch.testing.assert_close(step.at(inner.value + tangent).motion.joints - seen, pushed, rtol=1e-4, atol=1e-4)
    assert step.take(torch.tensor([1])).motion.joints.shape == (1, 50, 22, 3)


def test_a_window_keeps_the_clock() -> None:
    motion = replace(Motion(walk(50)), t0=2.0)
    inside = torch.ones(10, dtype=torch.bool)
    part = Window(20, 30, inside, inside).of(motion)
    torch.testing.assert_close(part.times, motion.times[20:30])
