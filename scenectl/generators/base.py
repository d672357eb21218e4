"""What every generator shares: prompts in, steps that can be guided, a draft out.

A generator knows steps and never goals; a guide knows goals and never tokens, noise or codebooks. Every
method in the literature has moments at which its current belief can be decoded into a motion, so the
same goals plug into all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from jaxtyping import Bool, Float, Int
from torch import Tensor

from scenectl.generators.conditions import Conditions
from scenectl.generators.prompts import Prompts
from scenectl.generators.spec import Spec
from scenes.motion.motion import Motion, Pose2D

Progress = Callable[[str, float], None]
"""Called with what is being done and the fraction done, 0 to 1."""


def silent(what: str, fraction: float) -> None:
    """Progress that is not shown."""


@dataclass(frozen=True)
class Price:
    """What a step's products cost, in passes: one decodes a value and pulls one gradient back to it.

    Attributes:
        product: of one `jvp` or `vjp` at a value that is decoded already.
        row: of each cotangent more in `vjps`.
    """

    product: float
    row: float


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
        """The same step with another value, of as many samples; products are taken there."""
        ...

    def take(self, samples: Int[Tensor, " s"]) -> Step:
        """The same step of some samples; asked of the last step of a draft."""
        ...

    @property
    def motion(self) -> Motion:
        """The step's own value, decoded, detached."""
        ...

    @property
    def price(self) -> Price:
        """What its products cost: solvers that ask for many are chosen where they are cheap."""
        ...

    @property
    def unit(self) -> float:
        """Length in the value's space that a solver's prior counts as one."""
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
    """What a generator is handed to reach goals it knows nothing about; it answers and holds no state."""

    def log_prob(self, step: Step) -> Float[Tensor, " S"]:
        """Log-likelihood of the goals, up to a constant (Eq. 40), at the step's own value."""
        ...

    def gradient(self, step: Step) -> Float[Tensor, "S *v"]:
        """Gradient of `log_prob` in the step's value."""
        ...


@dataclass(frozen=True)
class Draft:
    """What a generator returns; the pipeline refines it.

    Attributes:
        motion: world coordinates, ``[S, T, J, 3]``.
        step: the last one, whose value decodes to `motion`: what refinement starts from. None where a family has none.
        trace: figures for the report, by name.
    """

    motion: Motion
    step: Step | None = None
    trace: dict[str, object] = field(default_factory=dict)


@runtime_checkable
class Generator(Protocol):
    """Prompts and a length in, a draft out; steered through a guide, or through conditions where the family can."""

    @property
    def name(self) -> str: ...

    @property
    def spec(self) -> Spec: ...

    @property
    def licence(self) -> str:
        """Licence of the weights, which is stored with every result."""
        ...

    def generate(
        self,
        prompts: Prompts | str,
        seconds: float,
        start: Pose2D,
        *,
        conditions: Conditions | None = None,
        guide: Guide | None = None,
        samples: int = 1,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> Draft:
        """Motions for prompts, ``[samples, T, J, 3]`` with T = seconds x `spec.fps`.

        Args:
            prompts: sentences with their times; one string is one for the whole motion.
            seconds: length.
            start: where the motion begins.
            conditions: goals as inputs of a network; families without such inputs ignore them.
            guide: steers every step.
            samples: how many motions.
            seed: decides everything that is random.
            progress: called with what is being done and the fraction done.

        Raises:
            UserError: prompts, a length or a number of samples that `spec` rules out.
        """
        ...


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
        prompts: Prompts | str,
        *,
        guide: Guide | None = None,
        samples: int = 1,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> Draft:
        """Motions in the frame and on the clock of the one given, ``[samples, T, J, 3]``, made anew where asked.

        What `motion` holds there is of no account; it is ``[T, J, 3]``, or one for each sample. Raises UserError for a
        motion it cannot edit.
        """
        ...


@runtime_checkable
class EditingGenerator(Generator, Editor, Protocol):
    """A generator that is an editor, too."""
