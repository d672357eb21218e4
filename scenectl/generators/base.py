"""What every generator shares: steps that can be guided, a guide it is handed, and motions out.

A generator knows steps and never goals; a guide knows goals and never tokens, noise or codebooks. Every
method in the literature has moments at which its current belief can be decoded into a motion, so the
same goals plug into all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from jaxtyping import Bool, Float
from torch import Tensor

from scenes.motion.motion import Motion, Pose2D

Progress = Callable[[str, float], None]
"""Called with what is being done and the fraction done, 0 to 1."""


@runtime_checkable
class Step(Protocol):
    """One moment at which a generator can be guided.

    `value` is what the generator believes at that moment (an expected token embedding, logits, a
    denoised estimate, a latent), with the samples along its first axis.
    """

    @property
    def value(self) -> Float[Tensor, "S *v"]: ...

    def decode(self, value: Float[Tensor, "S *v"]) -> Motion:
        """Motion in world coordinates, ``[S, T, J, 3]``, differentiable in `value`."""
        ...

    def at(self, value: Float[Tensor, "S *v"]) -> Step:
        """The same step with another value, of as many samples or of fewer; products are taken there."""
        ...

    @property
    def motion(self) -> Motion:
        """The step's own value, decoded, detached."""
        ...

    def jvp(self, tangent: Float[Tensor, "S *v"]) -> Float[Tensor, "S T J 3"]:
        """Change of the joints (m) for a change of the value, to first order."""
        ...

    def vjp(self, cotangent: Float[Tensor, "S T J 3"]) -> Float[Tensor, "S *v"]:
        """Gradient in the value for a gradient in the joints."""
        ...

    def vjps(self, cotangents: Float[Tensor, "R S T J 3"]) -> Float[Tensor, "R S *v"]:
        """Gradients for R of them at once."""
        ...


@runtime_checkable
class Guide(Protocol):
    """What a generator is handed to reach goals it knows nothing about."""

    def log_prob(self, step: Step) -> Float[Tensor, " S"]:
        """Log-likelihood of the goals, up to a constant (Eq. 40), at the step's own value."""
        ...

    def gradient(self, step: Step) -> Float[Tensor, "S *v"]:
        """Gradient of `log_prob` in the step's value."""
        ...

    def refine(self, step: Step) -> Float[Tensor, "S *v"]:
        """A value near the step's own that meets the goals better (Eq. 12)."""
        ...

    def finish(self, made: Generation) -> Generation:
        """The guide's last word, in joints, on what a generator made: handed to it at the end, and returned."""
        ...


@dataclass(frozen=True)
class Generation:
    """What a generator returns.

    Attributes:
        motion: world coordinates, ``[S, T, J, 3]``.
        unrefined: the same before refinement, or None where nothing was refined.
        trace: figures the generator wants in the report, by name.
    """

    motion: Motion
    unrefined: Motion | None = None
    trace: dict[str, object] = field(default_factory=dict)


@runtime_checkable
class Generator(Protocol):
    """Text and length in, motions out; steered only through a guide, to which `generate` hands its result at last."""

    @property
    def name(self) -> str: ...

    @property
    def fps(self) -> float: ...

    @property
    def licence(self) -> str:
        """Licence of the weights, which is stored with every result."""
        ...

    def generate(
        self,
        prompt: str,
        seconds: float,
        start: Pose2D,
        guide: Guide | None = None,
        samples: int = 1,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> Generation: ...


@runtime_checkable
class Editor(Protocol):
    """A generator that can also make parts of a finished motion anew, and the rest as it was, or nearly so.

    What is kept may come back with the generator's own error of reconstruction; `scenectl.pipeline.editing.edit`
    puts the original's frames back and smooths the seams, for any editor.
    """

    def edit(
        self,
        motion: Motion,
        regenerate: Bool[Tensor, " T"],
        prompt: str,
        guide: Guide | None = None,
        samples: int = 1,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> Generation:
        """Motions in the frame of the one given, ``[samples, T, 22, 3]``, made anew where `regenerate` says.

        What `motion` holds there is of no account. Raises UserError for a motion it cannot edit.
        """
        ...
