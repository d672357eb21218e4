"""Why goals are not met: the culprit is named, and what is out of reach is told from what was merely missed."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch

from objectives import Objective, Term, diagnosis
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D
from tests.objectives.cases import context, standing


def motion(frames: int = 60) -> Motion:
    """A person who stands at the origin for three seconds."""
    return Motion(standing(frames))


def wrist(at: list[float], move: dict[int, list[float]], **options: Any) -> Term:
    """The left wrist where it is, but for some targets (counted from 0) that are moved."""
    here = motion().joint("left_wrist")[0].tolist()
    places = [[h + d for h, d in zip(here, move.get(i, [0, 0, 0]), strict=True)] for i in range(len(at))]
    return Term("joint_target", {"joint": "left_wrist", "position": places}, at=at, tolerance=0.01, **options)


def test_nothing_is_said_where_all_is_met() -> None:
    assert diagnosis(Objective((wrist([0.5, 1.0], {}),)), motion(), context()) is None
    assert diagnosis(Objective(), motion(), context()) is None


def test_the_target_that_is_missed_is_named_with_what_became_of_the_others() -> None:
    said = diagnosis(Objective((wrist([0.5, 1.0, 2.4], {2: [0.0, 0.4, 0.0], 0: [0.002, 0, 0]}),)), motion(), context())
    assert said == "target 3 (left wrist, 2.40 s) is met to 40 cm only; the others to 2 mm"


def test_a_target_above_any_reach_is_out_of_it_by_the_rest() -> None:
    here = float(motion().joint("left_wrist")[0, 1] - motion().joints[..., 1].min())
    reach = HUMANML3D.span("left_foot", "left_wrist") + 0.5
    said = diagnosis(Objective((wrist([0.5, 1.0], {1: [0.0, reach + 0.38 - here, 0.0]}),)), motion(), context())
    assert said is not None and said.startswith("target 2 (left wrist, 1.00 s) is 38 cm out of reach; met to ")


def test_a_target_below_the_ground_is_out_of_reach_by_its_depth() -> None:
    down = float(motion().joint("left_wrist")[0, 1] - motion().joints[..., 1].min()) + 0.42
    said = diagnosis(Objective((wrist([0.5, 1.0], {1: [0.0, -down, 0.0]}),)), motion(), context())
    assert said is not None and said.startswith("target 2 (left wrist, 1.00 s) is 42 cm out of reach; met to ")


def test_a_target_too_far_from_the_start_or_from_another_is_out_of_reach() -> None:
    far = 8.0 * 0.5 + HUMANML3D.span("pelvis", "left_wrist") + 3.0
    said = diagnosis(Objective((wrist([0.5], {0: [0.0, 0.0, far]}),)), motion(), context())
    assert said is not None and "out of reach of the start" in said
    said = diagnosis(Objective((wrist([1.9, 2.0], {1: [0.0, 0.0, 3.0]}),)), motion(), context())
    assert said == (
        "target 2 (left wrist, 2.00 s) is 220 cm out of reach of target 1 (left wrist, 1.90 s); met to 300 cm; "
        "the others to 0 mm"
    )


def test_two_hands_cannot_be_torn_apart() -> None:
    right = motion().joint("right_wrist")[0]
    target = {"joint": "right_wrist", "position": (right + right.new_tensor([-3.0, 0, 0])).tolist()}
    other = Term("joint_target", target, at=1.0, tolerance=0.01, name="right hand")
    said = diagnosis(Objective((wrist([1.0], {}), other)), motion(), context())
    span = float((motion().joint("left_wrist")[0] - right).norm()) + 3.0 - HUMANML3D.span("left_wrist", "right_wrist")
    assert said is not None
    assert said.startswith(f"right hand: the target (right wrist, 1.00 s) is {100 * span:.0f} cm out of reach of the ")
    assert said.endswith("; the others to 0 mm")


def test_innocent_neighbours_of_a_culprit_are_not_called_out_of_reach() -> None:
    """Target 2 shuts 1 and 3 out, which are met: it is the one to blame, and by itself."""
    said = diagnosis(Objective((wrist([1.0, 1.1, 1.2], {1: [0, 0, 4.0], 2: [0.02, 0, 0]}),)), motion(), context())
    assert said is not None
    assert said.startswith("target 2 (left wrist, 1.10 s) is 320 cm out of reach; met to 400 cm; ")
    assert "target 3 (left wrist, 1.20 s) is met to 2 cm only" in said


def test_many_misses_are_counted_and_other_goals_are_named_by_their_worst() -> None:
    spread = {i: [0.1 + 0.1 * i, 0.0, 0.0] for i in range(5)}
    said = diagnosis(Objective((wrist([0.5, 1.0, 1.5, 2.0, 2.5], spread),)), motion(), context())
    assert said is not None and said.endswith("; 2 more are not met") and said.count("only") == 3
    said = diagnosis(Objective((Term("height_limit", {"limit": 0.5}, name="beam"),)), motion(), context())
    assert said is not None and said == "beam is met to 109 cm only"


def test_a_dense_track_is_spoken_of_as_a_whole() -> None:
    term = Term("joint_target", {"position": [0.0, 1.0, 3.0]}, name="stay")  # every frame, of 100
    said = diagnosis(Objective((term,)), motion(100), context())
    assert said is not None and said.startswith("stay is met to ") and "target" not in said


def test_spans_are_the_lengths_of_chains() -> None:
    assert HUMANML3D.span("pelvis", "pelvis") == 0.0
    rest = torch.as_tensor(HUMANML3D.bone_lengths)
    names = ("left_collar", "left_shoulder", "left_elbow", "left_wrist")
    arm = float(rest[HUMANML3D.indices(names)].sum())
    assert HUMANML3D.span("spine3", "left_wrist") == pytest.approx(arm)
    assert HUMANML3D.span("left_wrist", "right_wrist") == pytest.approx(2 * arm, rel=0.1)
    assert HUMANML3D.span("left_wrist", "right_wrist") == HUMANML3D.span("right_wrist", "left_wrist")
    assert math.isfinite(HUMANML3D.span("head", "left_foot"))
