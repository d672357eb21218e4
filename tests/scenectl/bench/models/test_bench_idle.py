"""Who stands: people made up from a pose, who sway, freeze, box or bend their knees."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import Tensor

from scenectl.bench.models import idle
from scenectl.bench.models.idle import bench_idle, stances
from scenectl.generators.base import Draft
from scenes.errors import UserError
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D
from tests.scenectl.tiny import TinyGenerator, statue
from tests.scenectl.training.folder import walks


def standing(seconds: float, sway: float = 0.01, stir: float = 1.0) -> Tensor:
    """Somebody with hanging arms who sways by so many metres."""
    joints = statue().clone()
    for side in ("left", "right"):
        shoulder, elbow, wrist = (HUMANML3D.index(f"{side}_{name}") for name in ("shoulder", "elbow", "wrist"))
        joints[elbow] = joints[shoulder] + torch.tensor([0.0, -0.26, 0.0])
        joints[wrist] = joints[elbow] + torch.tensor([0.0, -0.25, 0.0])
    time = torch.arange(round(20 * seconds)) / 20
    moved = joints.expand(len(time), 22, 3).clone()
    moved[:, :, 0] += sway * torch.sin(2 * torch.pi * stir * time)[:, None] * joints[:, 1] / joints[0, 1]
    return moved


class Standing(TinyGenerator):
    """Makes the same person whatever is asked."""

    def __init__(self, joints: Tensor) -> None:
        self.joints = joints

    def generate(self, *_: object, samples: int = 1, **__: object) -> Draft:
        return Draft(Motion(self.joints.expand(samples, -1, -1, -1)))


@pytest.fixture
def recorded(monkeypatch: pytest.MonkeyPatch) -> None:
    people = [standing(6.0, sway) for sway in (0.005, 0.008, 0.01, 0.015, 0.02, 0.03)]
    monkeypatch.setattr(idle, "_recorded", lambda data: people)


def raised(joints: Tensor) -> Tensor:
    up = joints.clone()
    up[:, HUMANML3D.index("left_wrist"), 1] += 0.5
    return up


def bent(joints: Tensor) -> Tensor:
    low = joints.clone()
    low[:, HUMANML3D.index("right_knee"), 2] += 0.15
    return low


@pytest.mark.parametrize(
    ("joints", "wrong"),
    [
        (standing(10.0), None),
        (standing(10.0, sway=0.0), "never_frozen"),
        (torch.cat([standing(6.0), standing(6.0)[-1:].expand(80, -1, -1)]), "never_frozen"),
        (standing(10.0, sway=0.1), "sways_as_people"),
        (raised(standing(10.0)), "arms_hang"),
        (bent(standing(10.0)), "knees_straight"),
    ],
)
def test_who_stands_does_and_who_does_not_is_called(recorded: None, joints: Tensor, wrong: str | None) -> None:
    summary = bench_idle(Standing(joints), Path(), samples=6)["summary"]
    assert summary["stands"] == (wrong is None) and (wrong is None or summary[wrong] == 0.0)
    assert all(summary[key] == 1.0 for key in ("arms_hang", "knees_straight") if key != wrong)
    assert summary["recorded"]["stands"] >= 0.6


def test_samples_are_spread_over_the_wordings_and_drawn(recorded: None, tmp_path: Path) -> None:
    result = bench_idle(Standing(standing(10.0)), Path(), samples=7, png=tmp_path / "all.png")
    prompts = [row["prompt"] for row in result["rows"]]
    assert [prompts.count(wording) for wording in idle.WORDINGS] == [2, 2, 1, 1, 1]
    assert (tmp_path / "all.png").stat().st_size > 5000


def test_figures_are_in_metres_and_degrees() -> None:
    found = stances(bent(standing(4.0, sway=0.02)))
    assert found["sway_m"].tolist() == pytest.approx([0.02 / 2**0.5] * 3, rel=0.02)
    assert found["knees_deg"].min() > 20 and found["wrists_m"].max() < 0.1
    assert len(stances(standing(1.9))["sway_m"]) == 0


def test_data_without_people_who_stand_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SCENECTL_CACHE", str(tmp_path / "cache"))
    with pytest.raises(UserError, match="0 windows of 2 s of people who stand"):
        bench_idle(TinyGenerator(), walks(tmp_path / "data"))
