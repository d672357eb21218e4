"""An objective: a sum of terms, its cost, its least-squares rows and its report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from objectives.checks import check_term
from objectives.context import Context
from objectives.report import TermReport
from objectives.term import Assessed, Term
from scenes.motion.motion import Motion
from scenes.motion.skeleton import Skeleton


@dataclass(frozen=True)
class Objective:
    """A sum of terms: log p(G | x) = -cost (MSCoT Eq. 40).

    Attributes:
        terms: in the order given; equal names are numbered so that a report can tell them apart. A term of weight 0
            equals an absent one everywhere.
    """

    terms: tuple[Term, ...] = ()

    def __post_init__(self) -> None:
        seen: dict[str, int] = {}
        named = []
        for term in tuple(self.terms):
            seen[term.name] = seen.get(term.name, 0) + 1
            named.append(term if seen[term.name] == 1 else replace(term, name=f"{term.name} {seen[term.name]}"))
        object.__setattr__(self, "terms", tuple(named))

    @classmethod
    def from_tables(cls, tables: Iterable[Mapping[str, Any]], folder: Path | None = None) -> Objective:
        """An objective from the [[goal]] tables of a task file in `folder`."""
        return cls(tuple(Term.from_table(table, folder) for table in tables))

    @property
    def counted(self) -> tuple[Term, ...]:
        """The terms whose weight is not 0."""
        return tuple(term for term in self.terms if term.weight > 0)

    def cost(self, motion: Motion, context: Context) -> Float[Tensor, "*b"]:
        """Cost of every sample; differentiable in the motion's joints, zero where every goal is met."""
        return self.judge(motion, context)[0]

    def judge(self, motion: Motion, context: Context) -> tuple[Float[Tensor, "*b"], Bool[Tensor, "*b"]]:
        """`cost` and `met`, every goal evaluated once."""
        total = motion.joints[..., :0].sum((-3, -2, -1))  # a zero that autograd knows, whatever the terms
        all_met = torch.ones(motion.joints.shape[:-3], dtype=torch.bool, device=motion.joints.device)
        for term in self.counted:
            cost, met = term.judge(motion, context)
            total, all_met = total + cost, all_met & met
        return total, all_met

    def residuals(self, motion: Motion, context: Context) -> list[Float[Tensor, "*b _F _k"]]:
        """Weighted rows for least-squares solvers, one block for each term (see `Term.block`).

        Where all kernels are `squared`, the sum of all squares is the cost of the sample; always, its gradient is
        the gradient of the cost.
        """
        return [term.block(motion, context) for term in self.counted]

    def assess(self, motion: Motion, context: Context) -> Assessed:
        """`residuals`, `cost` and `met`, every goal evaluated once; only the rows have a gradient."""
        parts = [term.assess(motion, context) for term in self.counted]
        shape = motion.joints.shape[:-3]
        cost, met = motion.joints.new_zeros(shape), torch.ones(shape, dtype=torch.bool, device=motion.joints.device)
        for part in parts:
            cost, met = cost + part.cost, met & part.met
        return Assessed([rows for part in parts for rows in part.rows], cost, met)

    @torch.no_grad()
    def met(self, motion: Motion, context: Context) -> Bool[Tensor, "*b"]:
        """Which samples have every term within its tolerance."""
        return self.judge(motion, context)[1]

    @torch.no_grad()
    def report(self, motion: Motion, context: Context) -> list[list[TermReport]]:
        """For each sample (batch axes flattened; an unbatched motion is one sample), a row for each term."""
        columns = [term.report(motion, context) for term in self.counted]
        samples = motion.valid[..., 0].numel()
        return [[column[sample] for column in columns] for sample in range(samples)]

    def check(
        self,
        context: Context,
        seconds: float,
        fps: float = 20.0,
        t0: float = 0.0,
        skeleton: Skeleton | None = None,
        slack: float = 0.5,
    ) -> None:
        """Find mistakes before a model is loaded; raises UserError naming the term.

        Every time must lie inside the motion (t0 to t0 + seconds), every joint be known, every file readable, every
        stated position and track inside the scene's bounds widened by `slack` metres, and every term active at
        some frame of a person standing in the scene; by default one with the body's skeleton.
        """
        for term in self.counted:
            check_term(term, context, seconds, fps, t0, skeleton or context.body.skeleton, slack)
