"""From residuals to cost: kernels, and the weights that make a least-squares problem of any of them."""

from __future__ import annotations

from typing import Literal, get_args

import torch
from jaxtyping import Float
from torch import Tensor

from objectives.maths import root

Kernel = Literal["squared", "linear", "huber", "geman_mcclure"]
Reduction = Literal["sum", "mean"]
KERNELS: tuple[str, ...] = get_args(Kernel)
REDUCTIONS: tuple[str, ...] = get_args(Reduction)

# Below this length (m, rad, m/s) the weight of a linear residual stops growing: 1/r has no limit at 0.
_SMALLEST = 1e-4


def kernel_cost(kernel: Kernel, square: Float[Tensor, "*s"], delta: float) -> Float[Tensor, "*s"]:
    """Cost of entries whose squared length is `square`.

    squared: r^2 (no 1/2). linear: r, with a zero subgradient at 0. huber: r^2 up to `delta`, then
    2 delta r - delta^2, so that it equals `squared` near zero and is continuously differentiable. geman_mcclure:
    delta^2 r^2 / (delta^2 + r^2), which is r^2 near zero and never more than delta^2: what is far off hardly pulls.
    """
    if kernel == "squared":
        return square
    if kernel == "linear":
        return root(square)
    if kernel == "geman_mcclure":
        return delta**2 * square / (delta**2 + square)
    return torch.where(square <= delta**2, square, 2 * delta * root(square) - delta**2)


def least_squares_weight(kernel: Kernel, square: Float[Tensor, "*s"], delta: float) -> Float[Tensor, "*s"]:
    """Weight w, a constant to autograd, for which w r^2 has the gradient of the kernel: w = rho'(r) / (2 r).

    These are the weights of iteratively reweighted least squares. For `squared` w = 1 and w r^2 is the cost
    itself; for `linear` w r^2 is r / 2 and for `huber` it lies between half the cost and the cost; for `geman_mcclure`
    below the cost.
    """
    square = square.detach()
    if kernel == "squared":
        return torch.ones_like(square)
    if kernel == "geman_mcclure":
        return (delta**2 / (delta**2 + square)).square()
    size = square.sqrt().clamp_min(_SMALLEST)
    if kernel == "linear":
        return 0.5 / size
    return (delta / size).clamp_max(1.0)
