"""ProgMoGen's tasks: scores against the protocol's formulas written out, and a run with a puppet for a generator."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from scenectl.bench.control.progmogen import COLUMNS, Case, bench_progmogen, cases, score, table
from scenectl.bench.control.progmogen_prompts import HeadHeights, ProgMoGenPrompts, Prompt
from scenectl.bench.engine import Engine
from scenectl.control import SolverSettings
from scenectl.generators.base import Draft, Guide, Progress
from scenectl.generators.conditions import Conditions
from scenectl.generators.prompts import Prompts
from scenectl.generators.spec import Spec
from scenectl.generators.steps import DecodedStep
from scenes.errors import UserError
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.skeleton import HUMANML3D

PROMPTS = ProgMoGenPrompts(
    hsi1=(
        HeadHeights(caption="a person walks.", length=60, head_heights_m=(1.5, 1.5, 1.5)),
        HeadHeights(caption="a person sits down.", length=40, head_heights_m=(1.5, 0.9, 1.4)),
    ),
    n32=(Prompt(caption="a man jogs.", length=52), Prompt(caption="a person leaps.", length=196)),
)


def standing() -> Tensor:
    joints = torch.zeros(22, 3)
    for joint in range(1, 22):
        joints[joint] = joints[HUMANML3D.parents[joint]] + torch.tensor(HUMANML3D.offsets[joint])
    return joints - joints[:, 1].min() * torch.tensor([0.0, 1.0, 0.0])


class Puppet:
    """A person who walks off at 1 m/s; the value of its one step shifts every joint in every frame."""

    name, licence, spec = "puppet", "none", Spec(fps=20.0, shortest=0.5, longest=20.0, window=9.8)

    def __init__(self) -> None:
        self.calls: list[tuple[str, float, int, bool]] = []

    def generate(
        self, prompts: Prompts | str, seconds: float, start: Pose2D, *, conditions: Conditions | None = None,
        guide: Guide | None = None, samples: int = 1, seed: int = 0, progress: Progress | None = None,
    ) -> Draft:  # fmt: skip
        self.calls.append((Prompts.of(prompts).single(self.name), seconds, seed, guide is not None))
        frames = self.spec.frames(seconds)
        noise = torch.randn(samples, frames, 22, 3, generator=torch.Generator().manual_seed(seed)) * 0.003
        walk = torch.arange(frames)[:, None, None] * torch.tensor([0.0, 0.0, 0.05])
        base = standing() + walk + noise
        step = DecodedStep(
            torch.zeros(samples, frames, 66), lambda v: Motion(base + v.unflatten(-1, (22, 3))).placed(start)
        )
        return Draft(step.motion, step)


def random_motion(frames: int, seed: int) -> Motion:
    generator = torch.Generator().manual_seed(seed)
    return Motion(standing() + torch.randn(frames, 22, 3, generator=generator).cumsum(0) * 0.08)


def relu(x: Any) -> np.ndarray:
    return np.maximum(0, x)


@pytest.mark.parametrize("seed", range(4))
def test_scores_are_the_published_expressions(seed: int) -> None:
    length = 52 + seed
    motion = random_motion(196, seed)
    p = motion.joints.double().numpy()
    y, m, e = p[..., 1], length // 2, length - 1
    heights = (1.5, 1.2, 1.4)
    one = score(Case("hsi1", 0, "a", length, length, heights), motion)
    errors = [abs(y[frame, 15] - h) for frame, h in zip((0, m, e), heights, strict=True)]
    assert math.isclose(float(one["constraint_error_m"]), sum(errors) / 3, abs_tol=1e-6)
    assert one["success"] == all(error < 0.05 for error in errors)
    two = score(Case("hsi2", 0, "a", length, length), motion)
    hinges = relu(1.5 - y[0, 15]) + relu(1.5 - y[e, 15]) + relu(y[m, 15] - 0.5)
    feet = relu(y[m, 10]) + relu(y[m, 11])
    assert math.isclose(float(two["constraint_error_m"]), hinges / 3 + feet / 2, abs_tol=1e-6)
    three = score(Case("hsi3", 0, "a", length, 196), motion)
    x, z = p[..., 0], p[..., 2]
    for key, frames in (("constraint_error_m", 196), ("constraint_error_cropped_m", length)):
        sides = (relu(x - 1), relu(-1 - x), relu(z - 1), relu(-1 - z))
        expected = sum(side[:frames].mean() for side in sides) / 4
        assert math.isclose(float(three[key]), expected, abs_tol=1e-6)
    # only the frames asked for count for skating and acceleration, whatever comes after them
    second = np.linalg.norm(np.diff(p[:length], 2, axis=0), axis=-1).max()
    for figures in (one, two, three):
        assert math.isclose(float(figures["max_acceleration_m_per_frame2"]), second, rel_tol=1e-5)
        assert math.isclose(float(figures["lowest_foot_m"]), p[:length, 10:12, 1].min(), abs_tol=1e-6)


def test_skating_is_cropped_to_the_length() -> None:
    still = Motion(standing().expand(100, 22, 3).clone())
    slide = torch.arange(50)[:, None, None] * torch.tensor([0.05, 0.0, 0.0])
    still.joints[50:] += slide
    assert score(Case("hsi2", 0, "a", 50, 50), still)["skating_ratio"] == 0
    later = score(Case("hsi2", 0, "a", 100, 100), still)["skating_ratio"]
    assert 0.4 < later < 0.5


def test_success_is_strict() -> None:
    motion = Motion(standing().double().expand(41, 22, 3).clone())
    head = float(motion.joints[0, 15, 1])
    near = score(Case("hsi1", 0, "a", 41, 41, (head, head + 0.0499, head)), motion)
    far = score(Case("hsi1", 0, "a", 41, 41, (head, head + 0.0501, head)), motion)
    assert near["success"] is True and far["success"] is False
    assert math.isclose(float(far["constraint_error_m"]), 0.0501 / 3, abs_tol=1e-9)


def test_cases_are_the_first_prompts() -> None:
    assert [case.hard for case in cases(PROMPTS, "hsi1")] == [False, True]
    assert [case.frames for case in cases(PROMPTS, "hsi3")] == [196, 196]
    assert [case.frames for case in cases(PROMPTS, "hsi3", padded=False)] == [52, 196]
    assert len(cases(PROMPTS, "hsi2", 1)) == 1
    with pytest.raises(UserError, match="did you mean 'hsi1'"):
        cases(PROMPTS, "his1")
    with pytest.raises(UserError, match="hsi2 has 2 prompts; ask for 1 to 2 and not 3"):
        cases(PROMPTS, "hsi2", 3)


def test_control_reaches_what_chance_does_not() -> None:
    puppet = Puppet()
    seen: list[float] = []
    result = bench_progmogen(
        puppet,
        PROMPTS,
        seed=7,
        solver=SolverSettings(iterations=60, prior=1e-4, natural=False),
        engine=Engine(lambda _, x: seen.append(x)),
    )
    for task in ("hsi1", "hsi2", "hsi3"):
        summary = result["summary"][task]
        assert summary["controlled"]["prompts"] == summary["uncontrolled"]["prompts"] == 2
        assert summary["controlled"]["constraint_error_m"] < 0.002, task
        assert summary["uncontrolled"]["constraint_error_m"] > 0.02, task
        assert summary["uncontrolled"]["skating_ratio"] > 0.5  # it glides
    assert result["summary"]["hsi1"]["controlled"]["unsuccess_rate"] == 0
    assert result["summary"]["hsi1"]["uncontrolled"]["unsuccess_rate"] > 0
    assert result["summary"]["hsi1"]["controlled_hard"]["prompts"] == 1
    assert seen == sorted(seen) and seen[-1] == 1
    # every prompt twice with one seed, once with a guide and once without
    assert len(puppet.calls) == len(result["rows"]) == 12
    for first, second in zip(puppet.calls[::2], puppet.calls[1::2], strict=True):
        assert first[:3] == second[:3] and first[3] and not second[3]
    assert {call[2] for call in puppet.calls} == {7, 8}
    assert json.loads(json.dumps(result, allow_nan=False)) == result


def test_the_table_has_a_row_for_each_method() -> None:
    result = bench_progmogen(Puppet(), PROMPTS, ("hsi2",), {"hsi2": 1}, solver=SolverSettings(iterations=2))
    rows = table(result)
    assert [row[1] for row in rows] == ["controlled", "uncontrolled", "ProgMoGen (published)", "MSCoT (published)"]
    assert all(len(row) == 3 + len(COLUMNS) for row in rows)
    assert "0.220" in rows[2] and rows[2][2] == "32"


def test_motions_that_are_not_numbers_stay_valid_json() -> None:
    class Broken(Puppet):
        def generate(self, *arguments: Any, **options: Any) -> Draft:
            made = super().generate(*arguments, **options)
            return Draft(replace(made.motion, joints=made.motion.joints * math.nan))

    result = bench_progmogen(Broken(), PROMPTS, ("hsi1",), {"hsi1": 1}, solver=SolverSettings(iterations=1))
    assert result["summary"]["hsi1"]["controlled"]["unsuccess_rate"] == 1
    json.dumps(result, allow_nan=False)


def test_wrong_generators_get_one_sentence() -> None:
    slow = Puppet()
    slow.spec = replace(slow.spec, fps=30.0)
    with pytest.raises(UserError, match="at 20 fps; generator 'puppet' makes 30"):
        bench_progmogen(slow, PROMPTS)
    with pytest.raises(UserError, match="made 10 of 52 frames"):
        score(Case("hsi2", 0, "a", 52, 52), random_motion(10, 0))
