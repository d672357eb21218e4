"""The loop under every training command: schedule, moving average, resume, loss curves."""

from __future__ import annotations

import copy
import json
import math
import statistics
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated

import torch
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from safetensors import safe_open
from safetensors.torch import save
from torch import Tensor, nn
from torch.optim.swa_utils import get_ema_multi_avg_fn

from scenectl.training.placement import Placement
from scenes.errors import UserError, visible
from scenes.files import atomic_write, sweep, write_json
from scenes.tables import Table
from scenes.validation import sentence

Figures = dict[str, float | Tensor]
"""Figures of one step by name; tensors stay on their device until they are logged, so that it never waits for us."""

StepFunction = Callable[[int, torch.Generator], tuple[Tensor, Figures]]
"""Iteration and its random generator in; loss and figures to log out. `FRAMES` among them gives the throughput."""

FRAMES, RATE = "frames", "frames_per_second"
"""Names of a step's number of frames, and of what the loss curve makes of it."""

_Sums = dict[str, list[float | Tensor]]
"""Figures since the last point of the curve."""

_MOMENT = "moment."

Curve = list[dict[str, int | float]]
"""Points of the loss curve."""

_NOT_SHOWN = ("iteration", "seconds", "lr", RATE)


class LoopSettings(Table):
    """How long and how fast to learn.

    Attributes:
        iterations: optimiser steps in all; a resumed run may name another number.
        batch: samples a step.
        learning_rate: peak of the cosine schedule, after `warmup` steps.
        weight_decay, clip: AdamW's decay, and the largest gradient norm.
        average: decay of the moving average of the weights, which is what gets shipped.
        save_seconds: how often the state is written, so that a kill costs no more than that.
        log_every: steps between two points of the loss curve.
    """

    iterations: int
    batch: int
    learning_rate: float = 2e-4
    warmup: int = 100
    weight_decay: float = 0.01
    clip: float = 1.0
    average: float = 0.995
    save_seconds: float = 120.0
    log_every: int = 20


class _Progress(BaseModel):
    """What a state says besides its tensors; states from before the curve was among it have None."""

    model_config = ConfigDict(strict=True, ser_json_inf_nan="constants")

    iteration: Annotated[int, Field(ge=0, le=2**53)]
    seconds: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    seed: int
    curve: Curve | None = None


class Loop:
    """Trains one module; its whole state is in `folder`, so that a killed run goes on where it was.

    Every iteration seeds its own random numbers from the run's seed and its index, so that a resumed run
    sees exactly what an uninterrupted one would have seen. The state on disk is of no device: a run may go on
    elsewhere than where it began (dropout and rounding then differ, as they do between machines).
    """

    def __init__(
        self, module: nn.Module, settings: LoopSettings, folder: Path, seed: int, place: Placement | None = None
    ) -> None:
        self.module, self.settings, self.folder, self.seed = module, settings, folder, seed
        self.device = (place or Placement()).device
        self.module.to(self.device)
        self.parameters = [p for p in module.parameters() if p.requires_grad]
        self.optimiser = torch.optim.AdamW(
            self.parameters,
            lr=settings.learning_rate,
            weight_decay=settings.weight_decay,
            betas=(0.9, 0.99),
            fused=self.device.type == "cuda",
        )
        self.averaged = copy.deepcopy(module)
        self._networks = nn.ModuleDict({"model": self.module, "averaged": self.averaged})
        self.iteration = 0
        self.seconds = 0.0
        self.curve: Curve = []
        self._resume()

    @property
    def state_path(self) -> Path:
        return self.folder / "state.safetensors"

    @property
    def frames_per_second(self) -> float | None:
        """Median throughput, which a pause of the machine does not spoil; None where it was not counted."""
        rates = [point[RATE] for point in self.curve if RATE in point]
        return statistics.median(rates) if rates else None

    def begin_at(self, weights: Mapping[str, Tensor]) -> None:
        """Take other initial weights, by name; raises RuntimeError where they are another network's."""
        self.module.load_state_dict(weights)
        self.averaged.load_state_dict(weights)

    def run(self, step: StepFunction, after: Callable[[], Figures] | None = None) -> None:
        """Train to the last iteration.

        Args:
            step: computes the loss of one iteration.
            after: called once the optimiser has moved (codebook updates); returns more figures to log.
        """
        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
        )
        with Progress(*columns) as progress:
            bar = progress.add_task(visible(self.folder.name), total=self.settings.iterations, completed=self.iteration)
            saved, logged, sums = time.monotonic(), time.monotonic(), _Sums()
            while self.iteration < self.settings.iterations:
                loss, figures = self._step(step)
                if after is not None:
                    figures = {**figures, **after()}
                self._average()
                self.iteration += 1
                for key, value in {"loss": loss, **figures}.items():
                    sums.setdefault(key, []).append(value)
                if self.iteration % self.settings.log_every == 0:
                    now = time.monotonic()
                    self._log(sums, now - logged)
                    logged = now
                    sums = _Sums()
                    progress.update(bar, completed=self.iteration, description=self._line())
                if time.monotonic() - saved > self.settings.save_seconds:
                    self._check(sums)
                    self.save()
                    saved = time.monotonic()
            progress.update(bar, completed=self.iteration)
        self._check(sums)
        self.save()

    def _step(self, step: StepFunction) -> tuple[Tensor, Figures]:
        generator = torch.Generator().manual_seed(self.seed * 1_000_003 + self.iteration)
        torch.manual_seed(self.seed * 1_000_003 + self.iteration)
        for group in self.optimiser.param_groups:
            group["lr"] = self.learning_rate()
        self.module.train()
        self.optimiser.zero_grad(set_to_none=True)
        loss, figures = step(self.iteration, generator)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.parameters, self.settings.clip)
        self.optimiser.step()
        return loss.detach(), figures

    def _check(self, sums: _Sums) -> None:
        """Refuse to go on, or to save, after a loss that is no number; looks at all losses since the last point."""
        losses = [bool(torch.as_tensor(loss).isfinite()) for loss in sums.get("loss", [])]
        if not all(losses):
            first = self.iteration - len(losses) + losses.index(False)
            raise UserError(
                f"training '{self.folder.name}' diverged at iteration {first}; lower learning_rate in its config"
            )

    def learning_rate(self) -> float:
        """Linear warm-up, then a cosine to one per cent of the peak."""
        s = self.settings
        if self.iteration < s.warmup:
            return s.learning_rate * (self.iteration + 1) / s.warmup
        done = (self.iteration - s.warmup) / max(s.iterations - s.warmup, 1)
        return s.learning_rate * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * min(done, 1.0))))

    @torch.no_grad()
    def _average(self) -> None:
        decay = min(self.settings.average, (1 + self.iteration) / (10 + self.iteration))
        means, own = list(self.averaged.parameters()), list(self.module.parameters())
        get_ema_multi_avg_fn(decay)(means, own, self.iteration)
        for kept, now in zip(self.averaged.buffers(), self.module.buffers(), strict=True):
            kept.copy_(now)

    def _log(self, sums: _Sums, elapsed: float) -> None:
        self._check(sums)
        self.seconds += elapsed
        # A run that was resumed between two points has fewer values for the first one.
        point = {key: float(sum(values)) / len(values) for key, values in sums.items() if key != FRAMES}
        if FRAMES in sums:
            point[RATE] = float(sum(sums[FRAMES])) / max(elapsed, 1e-9)
        self.curve.append({"iteration": self.iteration, "seconds": self.seconds, "lr": self.learning_rate(), **point})

    def _line(self) -> str:
        point = self.curve[-1]
        figures = " ".join(f"{k} {v:.4g}" for k, v in point.items() if k not in _NOT_SHOWN)
        name, speed = visible(self.folder.name), f"{self.iteration / max(self.seconds, 1e-9):.2f} it/s"
        return f"{name}: {figures} ({speed}{f', {point[RATE]:,.0f} frames/s' if RATE in point else ''})"

    def save(self) -> None:
        """Write the state, in which the loss curve is, and the curve once more for people."""
        tensors = {n: t.detach().cpu().clone().contiguous() for n, t in self._networks.state_dict().items()}
        for i, parameter in enumerate(self.parameters):
            for key, value in self.optimiser.state.get(parameter, {}).items():
                tensors[f"{_MOMENT}{i}.{key}"] = torch.as_tensor(value).cpu().clone()
        about = _Progress(iteration=self.iteration, seconds=self.seconds, seed=self.seed, curve=self.curve)
        with atomic_write(self.state_path) as file:
            file.write(save(tensors, metadata={"about": about.model_dump_json()}))
        write_json(self.curve, self.folder / "curve.json")

    def _resume(self) -> None:
        sweep(self.folder)
        if not self.state_path.is_file():
            return
        try:
            with safe_open(self.state_path, framework="pt") as file:
                about = _Progress.model_validate_json(file.metadata()["about"])
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a dict
            if strange := [name for name, tensor in tensors.items() if not bool(tensor.isfinite().all())]:
                raise ValueError(f"{strange[0]} holds numbers that are not finite")
            moments = {name: tensors.pop(name) for name in list(tensors) if name.startswith(_MOMENT)}
            self._networks.load_state_dict(tensors)
            self._resume_moments(moments)
            self.iteration, self.seconds = about.iteration, about.seconds
            self.curve = self._curve_beside() if about.curve is None else about.curve
        except Exception as error:  # of many kinds; all mean the same to a user
            lines = str(error).splitlines()
            reason = (
                sentence(error, None, _Progress) if isinstance(error, ValidationError) else lines[0] if lines else ""
            )
            raise UserError(
                f"training state '{self.state_path}' does not fit this config ({reason or type(error).__name__}); "
                "delete the folder to start afresh"
            ) from error

    def _resume_moments(self, moments: Mapping[str, Tensor]) -> None:
        """AdamW's moments, named `moment`, index of the parameter, and key; raises for what it would not have saved."""
        found = dict[int, dict[str, Tensor]]()
        for name, tensor in moments.items():
            index, key = name.removeprefix(_MOMENT).split(".")
            found.setdefault(int(index), {})[key] = tensor
        for i, state in found.items():
            parameter = self.parameters[i]
            shapes = {"step": (), "exp_avg": parameter.shape, "exp_avg_sq": parameter.shape}
            if i < 0 or {key: tensor.shape for key, tensor in state.items()} != shapes:
                raise ValueError(f"{_MOMENT}{i} is not of the shape of its parameter")
            if float(state["step"]) < 0 or bool((state["exp_avg_sq"] < 0).any()):
                raise ValueError(f"{_MOMENT}{i} is negative")
            # The count of steps stays on the CPU, where AdamW expects it.
            self.optimiser.state[parameter] = {
                key: tensor if key == "step" else tensor.to(parameter.device) for key, tensor in state.items()
            }

    def _curve_beside(self) -> Curve:
        """The curve of a state from before it was part of the state."""
        path = self.folder / "curve.json"
        return [p for p in json.loads(path.read_bytes()) if p["iteration"] <= self.iteration] if path.is_file() else []
