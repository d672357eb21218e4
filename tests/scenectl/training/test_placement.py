"""Device and precision: what 'auto' takes, and that a coarser precision changes numbers but not what is learned."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from scenectl.networks.precision import cpu_has_bfloat16
from scenectl.training.loop import Loop
from scenectl.training.placement import Placement, place
from scenes.errors import UserError
from tests.scenectl.generators.mscot.training.test_train import TINY, Killed, train, weights_of
from tests.scenectl.training.folder import same, walks


def test_a_cpu_computes_in_bfloat16_only_where_it_has_instructions_for_it(tmp_path: Path) -> None:
    facts = tmp_path / "cpuinfo"
    for flags, found in (("fpu avx512f", False), ("fpu avx512_bf16", True), ("amx_bf16 amx_tile", True)):
        facts.write_text(f"processor : 0\nflags : {flags}\n")
        assert cpu_has_bfloat16(facts) is found
    assert not cpu_has_bfloat16(tmp_path / "absent")
    assert place("cpu", "float32").compute is torch.float32 and place("cpu", "bfloat16").compute is torch.bfloat16
    assert place("cpu").compute is (torch.bfloat16 if cpu_has_bfloat16() else torch.float32)


def test_devices_that_are_not_there_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert place("auto").device.type == "cpu"
    with pytest.raises(UserError, match="--device cpu"):
        place("cuda")
    with pytest.raises(UserError, match="did you mean 'cuda'"):
        place("cida")


def test_autocast_is_silent_in_float32() -> None:
    net, x = torch.nn.Linear(8, 8), torch.randn(2, 8)
    with Placement().autocast():
        assert net(x).dtype is torch.float32
    with Placement(compute=torch.bfloat16).autocast():
        assert net(x).dtype is torch.bfloat16


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return walks(tmp_path_factory.mktemp("data"))


def recipe(folder: Path, precision: str) -> Path:
    path = folder / f"{precision}.toml"
    path.write_text(TINY.replace("seed = 4", f'seed = 4\nprecision = "{precision}"'))
    return path


def test_bfloat16_trains_every_stage_close_to_float32_and_resumes_bit_for_bit(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = {p: train("all", data, recipe(tmp_path, p), tmp_path / p) for p in ("float32", "bfloat16")}
    for stage in ("tokenizer", "refiner", "transformer"):
        full, coarse = (json.loads((run / stage / "curve.json").read_text()) for run in runs.values())
        states = [weights_of(run / stage) for run in runs.values()]
        assert all(t.dtype in (torch.float32, torch.int64) for t in states[1].values())  # stored in full
        assert not same(*states) and coarse[0]["loss"] == pytest.approx(full[0]["loss"], rel=0.05)
    own = Loop._step

    def step(loop: Loop, function: object) -> object:
        if loop.iteration == 5:
            loop.save()
            raise Killed
        return own(loop, function)  # type: ignore[arg-type]

    monkeypatch.setattr(Loop, "_step", step)
    with pytest.raises(Killed):
        train("tokenizer", data, tmp_path / "bfloat16.toml", tmp_path / "killed")
    monkeypatch.setattr(Loop, "_step", own)
    train("tokenizer", data, tmp_path / "bfloat16.toml", tmp_path / "killed")
    assert same(weights_of(tmp_path / "killed" / "tokenizer"), weights_of(runs["bfloat16"] / "tokenizer"))


def test_throughput_is_counted_in_frames(data: Path, tmp_path: Path) -> None:
    train("tokenizer", data, recipe(tmp_path, "float32"), tmp_path / "run", iterations=4)
    curve = json.loads((tmp_path / "run" / "tokenizer" / "curve.json").read_text())
    frames = [point["frames_per_second"] * (point["seconds"] - before) for point, before in
              zip(curve, [0.0, *(p["seconds"] for p in curve)], strict=False)]  # fmt: skip
    # two steps a point: four windows of 32 frames, or five of 24
    assert all(240 <= round(count) <= 256 for count in frames)
