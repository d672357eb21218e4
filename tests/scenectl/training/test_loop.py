"""The training loop: resuming changes nothing, rates follow their schedule, damage is answered."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from scenectl.training.loop import Loop, LoopSettings
from scenes.errors import UserError
from tests.scenectl.training.folder import same


class Net(nn.Module):
    def __init__(self, width: int = 8) -> None:
        super().__init__()
        torch.manual_seed(3)
        self.net = nn.Sequential(nn.Linear(4, width), nn.Dropout(0.2), nn.ReLU(), nn.Linear(width, 1))
        self.register_buffer("seen", torch.zeros(()))


def settings(iterations: int = 12, **changes: object) -> LoopSettings:
    given = {"iterations": iterations, "batch": 4, "learning_rate": 1e-2, "warmup": 4, "log_every": 5, **changes}
    return LoopSettings.model_validate(given)


class Killed(Exception):
    pass


def train(folder: Path, how: LoopSettings, stop: int | None = None, width: int = 8, seed: int = 1) -> Loop:
    """Train on noise; with `stop`, save and die before that iteration."""
    model = Net(width)
    loop = Loop(model, how, folder, seed)

    def step(iteration: int, generator: torch.Generator) -> tuple[Tensor, dict[str, float]]:
        if iteration == stop:
            loop.save()
            raise Killed
        x = torch.randn(how.batch, 4, generator=generator)
        loss = (model.net(x)[:, 0] - x.sum(1)).square().mean()  # dropout draws from the global generator
        return loss, {"iteration_twice": 2.0 * iteration, **({"late": 1.0} if iteration >= 8 else {})}

    def after() -> dict[str, float]:
        model.seen.add_(1.0)
        return {"seen": float(model.seen)}

    loop.run(step, after)
    return loop


@pytest.mark.parametrize("stops", [[1], [5], [3, 4, 11]])
def test_a_killed_run_ends_where_an_uninterrupted_one_does(tmp_path: Path, stops: list[int]) -> None:
    whole = train(tmp_path / "whole", settings())
    for stop in stops:
        torch.manual_seed(stop)  # what else happened in the process does not matter
        with pytest.raises(Killed):
            train(tmp_path / "killed", settings(), stop)
    torch.randn(7)
    resumed = train(tmp_path / "killed", settings())
    assert resumed.iteration == whole.iteration == 12
    assert same(resumed.module.state_dict(), whole.module.state_dict())
    assert same(resumed.averaged.state_dict(), whole.averaged.state_dict())


def test_the_curve_goes_on_and_holds_means(tmp_path: Path) -> None:
    whole = train(tmp_path / "whole", settings())
    assert [p["iteration"] for p in whole.curve] == [5, 10]
    assert [p["iteration_twice"] for p in whole.curve] == [4.0, 14.0]
    assert [p["seen"] for p in whole.curve] == [3.0, 8.0]  # means of 1..5 and 6..10: what `after` says is logged too
    assert "late" not in whole.curve[0] and whole.curve[1]["late"] == 1.0  # a mean over the steps that had it
    with pytest.raises(Killed):
        train(tmp_path / "killed", settings(), 7)
    resumed = train(tmp_path / "killed", settings())
    assert [p["iteration"] for p in resumed.curve] == [5, 10]
    assert resumed.curve[0] == pytest.approx({**whole.curve[0], "seconds": resumed.curve[0]["seconds"]})
    assert resumed.curve[1]["iteration_twice"] == 16.0  # of steps 7, 8 and 9, and not their sum over five
    assert resumed.seconds > 0


def test_a_finished_run_is_left_alone_and_a_longer_one_goes_on(tmp_path: Path) -> None:
    first = train(tmp_path, settings())
    again = train(tmp_path, settings())
    assert same(again.module.state_dict(), first.module.state_dict()) and again.iteration == 12
    longer = train(tmp_path, settings(15))
    assert longer.iteration == 15 and not same(longer.module.state_dict(), first.module.state_dict())


def test_seeds_make_a_difference(tmp_path: Path) -> None:
    a, b = (train(tmp_path / str(seed), settings(), seed=seed) for seed in (1, 2))
    assert not same(a.module.state_dict(), b.module.state_dict())


def test_the_rate_warms_up_and_falls_as_a_cosine_to_a_hundredth(tmp_path: Path) -> None:
    loop = Loop(Net(), settings(104, warmup=4), tmp_path, 0)
    rates = []
    for iteration in range(105):
        loop.iteration = iteration
        rates.append(loop.learning_rate())
    assert rates[:5] == pytest.approx([0.0025, 0.005, 0.0075, 0.01, 0.01])
    assert rates[54] == pytest.approx(0.01 * (0.01 + 0.99 * 0.5)) and rates[104] == pytest.approx(1e-4)
    assert all(b <= a for a, b in zip(rates[3:-1], rates[4:], strict=True))
    assert rates[29] == pytest.approx(0.01 * (0.01 + 0.495 * (1 + math.cos(math.pi / 4))))
    loop.iteration = 500  # beyond its end, as a run resumed with fewer iterations has it
    assert loop.learning_rate() == pytest.approx(1e-4)


def test_the_average_follows_the_weights_and_copies_buffers(tmp_path: Path) -> None:
    early = train(tmp_path / "early", settings(3, average=0.5))
    assert float(early.averaged.seen) == float(early.module.seen)
    own, mean = early.module.net[0].weight, early.averaged.net[0].weight
    start = Net().net[0].weight
    assert 0 < (own - mean).norm() < (own - start).norm()
    at_once = train(tmp_path / "none", settings(3, average=0.0))
    assert same(at_once.module.state_dict(), at_once.averaged.state_dict())


def test_divergence_is_said_and_the_last_good_state_kept(tmp_path: Path) -> None:
    train(tmp_path, settings(2))
    model = Net()
    loop = Loop(model, settings(4), tmp_path, 0)
    before = (tmp_path / "state.safetensors").read_bytes()
    with pytest.raises(UserError, match="diverged at iteration 2"):
        loop.run(lambda i, g: (model.net(torch.full((1, 4), torch.nan)).sum(), {}))
    assert (tmp_path / "state.safetensors").read_bytes() == before


def test_a_damaged_state_or_one_of_another_network_is_answered(tmp_path: Path) -> None:
    train(tmp_path, settings(2))
    path = tmp_path / "state.safetensors"
    whole = path.read_bytes()
    save_file({"a": torch.zeros(2)}, tmp_path / "foreign")
    for content in (whole[:-10], whole[:40], b"", b"\x80\x04noise" * 20, (tmp_path / "foreign").read_bytes()):
        path.write_bytes(content)
        with pytest.raises(UserError, match="does not fit this config") as error:
            Loop(Net(), settings(), tmp_path, 0)
        assert "\n" not in str(error.value) and str(path) in str(error.value)
    path.write_bytes(whole)
    with pytest.raises(UserError, match="delete the folder"):
        Loop(Net(width=9), settings(), tmp_path, 0)


def test_the_curve_is_part_of_the_state_and_the_file_beside_it_is_written_from_there(tmp_path: Path) -> None:
    """A kill between the two writes leaves an old curve, or none, beside a new state."""
    whole = train(tmp_path / "whole", settings())
    with pytest.raises(Killed):
        train(tmp_path / "killed", settings(), 11)
    for content in (None, "[]", "[{"):
        (tmp_path / "again").mkdir(exist_ok=True)
        (tmp_path / "again" / "state.safetensors").write_bytes((tmp_path / "killed" / "state.safetensors").read_bytes())
        if content is not None:
            (tmp_path / "again" / "curve.json").write_text(content)
        resumed = train(tmp_path / "again", settings())
        assert [p["iteration"] for p in resumed.curve] == [p["iteration"] for p in whole.curve] == [5, 10]
        assert json.loads((tmp_path / "again" / "curve.json").read_text()) == resumed.curve


def test_a_state_from_before_the_curve_was_part_of_it_takes_the_curve_beside_it(tmp_path: Path) -> None:
    first = train(tmp_path, settings())
    rewritten(tmp_path, {}, {"iteration": 7, "seconds": 1.0, "seed": 1})
    loop = Loop(Net(), settings(), tmp_path, 1)
    assert loop.iteration == 7 and loop.curve == first.curve[:1]


def rewritten(folder: Path, tensors: dict[str, Tensor | None], about: object = None) -> None:
    """Change a state: tensors by name (None: leave out) and what it says."""
    path = folder / "state.safetensors"
    with safe_open(path, framework="pt") as file:
        metadata = file.metadata() if about is None else {"about": json.dumps(about)}
        known = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a dict
    save_file({name: value for name, value in {**known, **tensors}.items() if value is not None}, path, metadata)


HALF = {"iteration": 2, "seconds": 1.0, "seed": 1, "curve": []}


@pytest.mark.parametrize(
    ("tensors", "about"),
    [
        *(({}, {**HALF, "iteration": value}) for value in (1e30, -4, 2.5, None, "2", True, 2**70)),
        *(({}, {**HALF, "seconds": value}) for value in (-1.0, float("nan"), float("inf"), "soon")),
        *(({}, {**HALF, "curve": value}) for value in (3, [3], [{"loss": "low"}])),
        ({}, []), ({}, {}),
        *(({"averaged.net.0.weight": torch.full((8, 4), value)}, None) for value in (torch.inf, torch.nan)),
        ({"model.net.0.weight": torch.full((8, 4), torch.nan)}, None),
        ({"averaged.net.0.weight": None}, None),
        ({"moment.0.exp_avg": torch.zeros(3)}, None),
        ({"moment.0.exp_avg": torch.full((8, 4), torch.inf)}, None),
        ({"moment.0.exp_avg_sq": torch.full((8, 4), -1.0)}, None),
        ({"moment.0.exp_avg_sq": None}, None),
        ({"moment.0.step": torch.tensor(-3.0)}, None),
        ({"moment.0.step": torch.zeros(2)}, None),
        ({"moment.0.other": torch.zeros(8, 4)}, None),
        *(({f"moment.{i}.step": torch.tensor(1.0)}, None) for i in ("99", "-1", "x", "0.0")),
    ],
)  # fmt: skip
def test_a_state_that_no_training_writes_is_answered(
    tensors: dict[str, Tensor | None], about: object, tmp_path: Path
) -> None:
    train(tmp_path, settings(2))
    rewritten(tmp_path, tensors, about)
    with pytest.raises(UserError, match="does not fit this config") as error:
        Loop(Net(), settings(), tmp_path, 0)
    assert "\n" not in str(error.value) and len(str(error.value)) < 400


def test_what_a_killed_training_left_is_swept_when_it_goes_on(tmp_path: Path) -> None:
    code = (
        "import os, signal, sys; from scenes.files import atomic_write\n"
        "with atomic_write(sys.argv[1]) as file: os.kill(os.getpid(), signal.SIGKILL)"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "state.safetensors")], check=False)
    assert len(list(tmp_path.iterdir())) == 1
    Loop(Net(), settings(), tmp_path, 0)
    assert not list(tmp_path.iterdir())
