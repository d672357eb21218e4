"""A dense grid of signed distances, and its exact trilinear interpolant."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from scenes.errors import UserError
from scenes.files import atomic_write, read_arrays
from scenes.kernels import parts
from scenes.kernels.contact import SIDE, lowest, steepened
from scenes.kernels.query import interpolated
from scenes.numbers import MOST, NARROWEST, WIDEST

Evaluate: TypeAlias = Callable[[Tensor, bool], tuple[Tensor, Tensor | None]]

ENOUGH = 32_768
"""Points from which on a second thread pays."""

CROWDED, APART = 64, 16
"""Numbers in a row whose multiples crowd the caches (256 bytes), and those that a longer row has in addition."""


OUTSIDE = 256
"""Points outside a grid that are looked after together, so that little memory is needed."""

_COMPILED = (torch.float32, torch.float64)  # what kernels are compiled for


class Interpolated(ABC):
    """A field read off stored nodes, whose gradient comes with its value; a grid says how in `_evaluate`."""

    @property
    @abstractmethod
    def bounds(self) -> np.ndarray:
        """First and last node, ``[2, 3]``, metres."""

    @property
    @abstractmethod
    def widest(self) -> float:
        """Metres between nodes where they are farthest apart."""

    @abstractmethod
    def _evaluate(self, points: Tensor, with_gradient: bool) -> tuple[Tensor, Tensor | None]:
        """Value ``[n]`` and gradient ``[n, 3]`` (or None) at points ``[n, 3]``, outside autograd."""

    @abstractmethod
    def arrays(self) -> dict[str, np.ndarray]:
        """The grid as the arrays that `save` writes."""

    def distance(self, points: Float[Tensor, "*b 3"], time: Tensor | None = None) -> Float[Tensor, "*b"]:
        """Interpolant (m) at `points` (m, world), with its exact gradient.

        Outside the grid, which surfaces never leave, it is continuous and a bound from below: with the value v at the
        nearest point of the grid, b away, sqrt(v^2 + |b|^2 + 2 margin (|b_x| + |b_y| + |b_z|)) where that is free and
        `beyond` is 1, v + |b| where it is solid, and v - |b| where `beyond` is -1; `scenes.kernels.query.left` proves
        it. It exceeds the distance by no more than v does (`scenes.sdf.distances`, and voxel^2 / 4 v of interpolation).

        The gradient can be taken once; a second derivative raises RuntimeError. Points that are not finite give NaN or
        infinity. `time` is ignored: a grid does not move.
        """
        if points.shape[-1] != 3:
            raise UserError(f"points have shape {tuple(points.shape)}; give [*b, 3]")
        result: Tensor = Interpolant.apply(points, self._evaluate)  # type: ignore[no-untyped-call]
        return result

    def value_and_gradient(self, points: Float[Tensor, "*b 3"]) -> tuple[Float[Tensor, "*b"], Float[Tensor, "*b 3"]]:
        """What `distance` gives, and its gradient (no unit), in one pass and outside autograd."""
        value, gradient = self._evaluate(flat(points), with_gradient=True)
        assert gradient is not None
        return value.reshape(points.shape[:-1]), gradient.reshape(points.shape)

    def entered(self, points: Float[Tensor, "*b 3"]) -> tuple[Float[Tensor, "*b 3"], Float[Tensor, "*b"]]:
        """Where the way from points (m) outside the grid to the nearest surface enters it, and how sure that is.

        It is the point q of the border at which the way to q and the distance there are least together; their sum is
        the distance outside. Branch and bound finds a q with a sum that exceeds the least by a quarter of a voxel at
        most, or by a 1600th where that is more, because its cost grows with one over that. Not differentiable.

        Returns:
            q (m), and by how much more than a quarter of a voxel its sum may be too large (m); of points of the grid
            themselves, and 0.
        """
        given = flat(points).double()
        low, high = torch.from_numpy(self.bounds).to(given)
        place, error = given.clone(), torch.zeros_like(given[:, 0])
        outside = ((given < low) | (given > high)).any(-1) & given.isfinite().all(-1)
        for some in outside.nonzero()[:, 0].split(OUTSIDE):
            place[some], error[some] = self._entrance(given[some], low, high)
        return place.to(points).reshape(points.shape), error.to(points).reshape(points.shape[:-1])

    def _entrance(self, points: Tensor, low: Tensor, high: Tensor) -> tuple[Tensor, Tensor]:
        """The same for points ``[n, 3]`` that are all outside: rectangles of the six faces are halved."""
        best, where = points.new_full((len(points),), torch.inf), points.clone()
        allowed = ((points - points.clamp(low, high)).norm(dim=-1) / 1600).clamp_min(self.widest / 4)
        item = torch.arange(len(points), device=points.device).repeat(6)
        axes, size = torch.eye(3).to(points), (high - low) / 2
        centre = (low + size + torch.cat([axes, -axes]) * size).repeat_interleave(len(points), 0)
        half = (size * (1 - axes)).repeat(2, 1).repeat_interleave(len(points), 0)
        while len(item) > 0:
            value, way = self._evaluate(centre, with_gradient=False)[0].abs(), (points[item] - centre).abs()
            length, before = value + way.norm(dim=-1), best[item]
            best = best.scatter_reduce(0, item, length, "amin")
            better = (length == best[item]) & (length < before)
            where[item[better]] = centre[better]
            lowest = (way - half).clamp_min(0).norm(dim=-1) + value - half.norm(dim=-1)
            open_ = lowest < (best - allowed)[item]
            item, centre, half = item[open_], centre[open_], half[open_]
            step = torch.nn.functional.one_hot(half.argmax(-1), 3) * half / 2
            item, half = item.repeat(2), (half - step).repeat(2, 1)
            centre = torch.cat([centre - step, centre + step])
        return where, allowed - self.widest / 4

    def save(self, path: str | Path) -> None:
        """Write `arrays` to an .npz file, whole or not at all."""
        with atomic_write(path) as file:
            np.savez(file, allow_pickle=False, **self.arrays())


@dataclass(frozen=True, eq=False)
class SdfGrid(Interpolated):
    """Signed distances at the nodes of a cubic grid.

    Node ``[i, j, k]`` lies exactly at ``origin + spacing * (i, j, k)``: nodes, not cell centres, so that the
    array can be read without the mesh's bounds.

    Attributes:
        values: signed distance at the nodes, metres, positive in free space, ``[X, Y, Z]`` float32; never to be
            changed in place, as queries may keep a copy.
        origin: position of node ``[0, 0, 0]``, metres, world, ``[3]`` float64.
        spacing: edge of a voxel, metres.
        beyond: +1 where the space around the grid is free (an object), -1 where it is solid (around a room).
        margin: metres from the border to the nearest surface, or less; distances outside are the better for it.
    """

    values: Float[Tensor, "X Y Z"]
    origin: Float[Tensor, "3"]
    spacing: float
    beyond: float = 1.0
    margin: float = 0.0
    _copies: dict[torch.device, Tensor] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.values.ndim != 3 or min(self.values.shape) < 2:
            raise UserError(f"a distance grid needs 2 or more nodes along 3 axes, not shape {tuple(self.values.shape)}")
        if not (np.isfinite(self.spacing) and self.spacing > 0):
            raise UserError(f"a distance grid needs a positive spacing in metres, not {self.spacing}")
        object.__setattr__(self, "values", self.values.to(torch.float32).contiguous())
        object.__setattr__(self, "origin", self.origin.to(torch.float64))

    @property
    def widest(self) -> float:
        """Metres between nodes."""
        return self.spacing

    @property
    def bounds(self) -> np.ndarray:
        """First and last node, ``[2, 3]``, metres."""
        low = self.origin.cpu().numpy()
        return np.stack([low, low + self.spacing * (np.array(self.values.shape) - 1)])

    @property
    def shape(self) -> tuple[int, int, int]:
        """Nodes along x, y and z."""
        x, y, z = self.values.shape
        return x, y, z

    @property
    def nbytes(self) -> int:
        """Bytes in memory."""
        return self.values.nbytes

    def nodes(self, index: np.ndarray) -> np.ndarray:
        """World positions ``[..., 3]`` (m, float64) of the nodes with integer indices ``[..., 3]``."""
        positions: np.ndarray = self.origin.cpu().numpy() + self.spacing * index
        return positions

    def _evaluate(self, points: Tensor, with_gradient: bool) -> tuple[Tensor, Tensor | None]:
        """Value ``[n]`` and gradient ``[n, 3]`` (or None) at points ``[n, 3]``, by the kernel where it can run."""
        kind = points.dtype
        if not points.is_cpu or kind not in _COMPILED:
            return interpolate(points, self._values_on(points.device), self, with_gradient)
        # At 10,000 points what follows takes a quarter of the time without the kernel: each call counts.
        count = len(points)
        value, gradient = torch.empty(count, dtype=kind), torch.empty(count if with_gradient else 0, 3, dtype=kind)
        given, out = (*self._arrays, points.numpy()), (value.numpy(), gradient.numpy())
        in_parts(count, lambda begin, end: interpolated.compiled(*given, begin, end, *out))
        return value, gradient if with_gradient else None

    def near(self, points: np.ndarray) -> np.ndarray:
        """Values (m) of the nodes nearest to world points (m) ``[n, 3]``, of the border's for points outside."""
        index = np.rint((points - self.origin.cpu().numpy()) / self.spacing).astype(np.int64)
        x, y, z = index.clip(0, np.array(self.values.shape) - 1).T
        found: np.ndarray = self.values.detach().cpu().numpy()[x, y, z]
        return found

    def lowest_on_way(
        self, ends: Float[Tensor, "n 4 3"], enough: Float[Tensor, " n"], tolerance: float | int
    ) -> Float[Tensor, "n 2"]:
        """Where segments on their way meet the least of `distance`; see `scenes.world.contact.swept_clearance`.

        Args:
            ends: a0 and b0 at the beginning, a1 and b1 at the end, metres, world.
            enough: distance (m) above which nothing is looked for.
            tolerance: metres by which the value found may exceed the least.

        Returns:
            Shares of the segment and of the way, both in 0 to 1.
        """
        given, high = ends.detach().cpu().double().contiguous(), enough.detach().cpu().double().contiguous()
        shares, slopes = np.empty((len(given), 2)), self.slopes
        widest = np.concatenate([slopes[..., :3].min((0, 1, 2)), slopes[..., 3:].max((0, 1, 2))])
        arrays = (self.values.detach().cpu().numpy(), *self._arrays[2:], slopes, widest)
        work = (*arrays, given.numpy(), high.numpy(), float(tolerance))
        in_parts(len(given), lambda begin, end: lowest(*work, begin, end, shares))
        return torch.from_numpy(shares).to(ends)

    @cached_property
    def lipschitz(self) -> float:
        """The most by which `distance` changes over a metre, m/m; of exact distances at most about 3 ** 0.5."""
        greatest = np.maximum(-self.slopes[..., :3], self.slopes[..., 3:])
        return float(np.sqrt(np.square(greatest).sum(-1).max()))

    @cached_property
    def slopes(self) -> np.ndarray:
        """Range of the gradient of `distance` in blocks of `SIDE` voxels and their neighbours, ``[bx, by, bz, 6]``.

        Least along x, y, z, then greatest: in a voxel a partial derivative is a mean of differences along 4 edges.
        Blocks at the border cover all that is outside before them, too, where the distance to the grid changes by up
        to 1 m/m along each axis.
        """
        from scipy.ndimage import maximum_filter, minimum_filter

        values = self.values.detach().cpu().numpy()
        found = np.empty((*(-(-(n - 1) // SIDE) for n in values.shape), 6))
        found[..., :3], found[..., 3:] = np.inf, -np.inf
        parts(lambda i: steepened(values, float(self.spacing), i, i + 1, found), len(found), torch.get_num_threads())
        for axis in range(3):
            for edge in (0, -1):
                border = found[(slice(None),) * axis + (edge,)]
                border[..., :3], border[..., 3:] = np.minimum(border[..., :3], -1), np.maximum(border[..., 3:], 1)
        around: tuple[int, ...] = (3, 3, 3, 1)
        found[..., :3] = minimum_filter(found[..., :3], around, mode="nearest")
        found[..., 3:] = maximum_filter(found[..., 3:], around, mode="nearest")
        return found

    @cached_property
    def _arrays(self) -> tuple[Any, ...]:
        """What queries ask for: flat values, nodes along each axis and numbers in a row, origin, spacing, outside.

        Where rows begin at multiples of a large power of two, the neighbours of a point compete for the same few places
        of the processor's caches; such a grid is kept a second time, with longer rows, once it is queried.
        """
        values = self.values.detach().cpu().numpy()
        *plane, row = values.shape
        if row % CROWDED == 0:
            spread = np.zeros((*plane, row + APART), dtype=values.dtype)
            spread[..., :row] = values
            values = spread
        shape = (*plane, row, values.shape[-1])
        outside = float(self.beyond), self.outer_margin
        return values.reshape(-1), shape, self.origin.cpu().numpy(), float(self.spacing), *outside

    @cached_property
    def outer_margin(self) -> float:
        """The margin as distances outside take it, see `margin_of`."""
        return margin_of(self.values.detach().cpu().numpy(), self.margin) if self.beyond > 0 else 0.0

    def _values_on(self, device: torch.device) -> Tensor:
        if device == self.values.device:
            return self.values
        if device not in self._copies:
            self._copies[device] = self.values.to(device)
        return self._copies[device]

    def arrays(self) -> dict[str, np.ndarray]:
        """The grid as the arrays that `save` writes."""
        return {
            "values": self.values.cpu().numpy(),
            "origin": self.origin.cpu().numpy(),
            "spacing": np.float64(self.spacing),  # type: ignore[dict-item]  # 0-d arrays on disk
            "beyond": np.float64(self.beyond),  # type: ignore[dict-item]
            "margin": np.float64(self.margin),  # type: ignore[dict-item]
        }

    @classmethod
    def load(cls, path: str | Path) -> SdfGrid:
        """Read a file that `save` wrote; raises UserError for anything else."""
        return read_arrays(path, "distance grid", cls.from_arrays)

    @classmethod
    def from_arrays(cls, data: Any) -> SdfGrid:
        """Rebuild a grid from the mapping of arrays that `arrays` gave; raises ValueError where they are unsound."""
        values = stored(data, "values", np.float32, 3)
        return cls(torch.from_numpy(values), *stored_place(data))


class Interpolant(torch.autograd.Function):
    """Distances whose gradient comes with them, in one pass: ``Interpolant.apply(points, evaluate)``.

    `evaluate` takes points ``[n, 3]`` and whether a gradient is wanted, and gives values ``[n]`` and gradients
    ``[n, 3]`` (or None).
    """

    @staticmethod
    def forward(ctx: Any, points: Tensor, evaluate: Evaluate) -> Tensor:
        value, ctx.gradient = evaluate(flat(points), points.requires_grad)
        ctx.save_for_backward(points)  # the gradient is neither input nor output: as an attribute it costs half
        return value if points.ndim == 2 else value.view(points.shape[:-1])

    @staticmethod
    def backward(ctx: Any, grad_output: Tensor) -> tuple[Tensor, None]:
        (points,) = ctx.saved_tensors
        if not torch.is_grad_enabled():  # no second derivative can follow
            return _scaled(points, ctx.gradient, grad_output), None
        return _Scaled.apply(_Once.apply(points), ctx.gradient, grad_output), None  # type: ignore[no-untyped-call]


class _Scaled(torch.autograd.Function):
    """The first derivative: linear in the gradient that comes in, which Gauss-Newton's products ask for, and no more.

    A second derivative in the points is refused by `_Once`, through which they come. torch's `once_differentiable`
    refuses both, and only where the incoming gradient is itself differentiable: otherwise it treats the first
    derivative as a constant without a word.
    """

    @staticmethod
    def forward(ctx: Any, points: Tensor, gradient: Tensor, grad_output: Tensor) -> Tensor:
        ctx.save_for_backward(points, gradient)
        return _scaled(points, gradient, grad_output)

    @staticmethod
    def backward(ctx: Any, cotangent: Tensor) -> tuple[Tensor, None, Tensor]:
        points, gradient = ctx.saved_tensors
        return torch.zeros_like(points), None, (gradient.view(points.shape) * cotangent).sum(-1)


class _Once(torch.autograd.Function):
    """Points as they are; differentiating a gradient in them raises RuntimeError."""

    @staticmethod
    def forward(ctx: Any, points: Tensor) -> Tensor:
        return points.view_as(points)

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> None:
        raise RuntimeError(
            "the gradient of a grid's distance cannot be differentiated again: the interpolant has no second "
            "derivative across voxel faces; detach it, or use a solver that needs first derivatives only"
        )


def _scaled(points: Tensor, gradient: Tensor, grad_output: Tensor) -> Tensor:
    return gradient.view(points.shape) * grad_output.unsqueeze(-1)


def margin_of(values: np.ndarray, stated: float) -> float:
    """The margin (m) of a grid that is free outside, `stated` or less: what nodes of the border say at least.

    With it no slope outside is over 1: at an edge of the grid a surface is sqrt(2) margins away, at a corner sqrt(3).
    """
    least = stated
    for axes in range(1, 8):
        along = [axis for axis in range(3) if axes >> axis & 1]
        corner = values
        for axis in along:
            corner = corner.take([0, -1], axis=axis)
        least = min(least, float(corner.min()) / len(along) ** 0.5)
    return max(least, 0.0)


def stored(data: Any, name: str, kind: Any, axes: int) -> np.ndarray:
    """An array of a file, of the type and with as many axes as we write; raises ValueError for any other.

    Numbers with a point must be finite and at most `MOST`.
    """
    array = np.ascontiguousarray(data[name]) if axes else np.asarray(data[name])
    if array.dtype != kind or array.ndim != axes:
        raise ValueError(f"'{name}' has the type {array.dtype} and {array.ndim} axes, not {np.dtype(kind)} and {axes}")
    if array.dtype.kind == "f" and not (np.abs(array) <= MOST).all():
        raise ValueError(f"'{name}' holds numbers that are not finite, or over {MOST:.0e}")
    return array


FINEST = NARROWEST / 1000
"""Metres between nodes at least: the smallest shape at more nodes along a side than are made of one (512)."""


def stored_place(data: Any) -> tuple[Tensor, float, float, float]:
    """Origin, spacing, `beyond` and margin (0 in files of earlier versions) of a file; raises ValueError."""
    origin = stored(data, "origin", np.float64, 1)
    spacing, beyond = (float(stored(data, name, np.float64, 0)) for name in ("spacing", "beyond"))
    margin = float(stored(data, "margin", np.float64, 0)) if "margin" in data else 0.0
    if origin.shape != (3,) or not FINEST <= spacing <= WIDEST or beyond not in (-1.0, 1.0) or margin < 0:
        raise ValueError("'origin', 'spacing', 'beyond' or 'margin' is what no grid has")
    return torch.from_numpy(origin), spacing, beyond, margin


def flat(points: Tensor) -> Tensor:
    """Points ``[n, 3]`` in one piece, outside autograd."""
    plain = points.detach()
    return plain if plain.ndim == 2 and plain.is_contiguous() else plain.reshape(-1, 3).contiguous()


def in_parts(count: int, work: Callable[[int, int], Any]) -> None:
    """Do ``work(begin, end)`` for all points, on torch's number of threads where there are enough of them."""
    threads = min(torch.get_num_threads(), count // ENOUGH) if count >= 2 * ENOUGH else 1
    if threads <= 1:
        work(0, count)
        return
    size = -(-count // threads)
    parts(lambda i: work(i * size, min((i + 1) * size, count)), threads, threads)


def interpolate(points: Tensor, values: Tensor, grid: SdfGrid, with_gradient: bool) -> tuple[Tensor, Tensor | None]:
    """The same in torch, for other devices and types: value ``[n]`` and gradient ``[n, 3]`` (or None).

    Outside the grid as `scenes.kernels.query.left` says.
    """
    size = points.new_tensor(values.shape) - 1
    # Subtracting the origin in double keeps scenes far from zero exact, as in "origin in world metres".
    local = ((points.double() - grid.origin.to(points.device)) / grid.spacing).to(points.dtype)
    inside = local.clamp_min(0).minimum(size)
    cell = inside.floor().nan_to_num(0.0).minimum(size - 1)
    x, y, z = (inside - cell).unbind(-1)
    corners = _corners(values, cell.long()).to(points.dtype)
    # Collapse z, then y, then x; the differences met on the way are the partial derivatives.
    along_z = corners[1::2] - corners[0::2]  # (x, y) in 00 01 10 11
    flat = corners[0::2] + along_z * z
    along_y = flat[1::2] - flat[0::2]
    line = flat[0::2] + along_y * y
    along_x = line[1] - line[0]
    value = line[0] + along_x * x
    beyond = (local - inside) * grid.spacing
    free = value.clamp_min(0) if grid.beyond > 0 else torch.zeros_like(value)
    beside = (2 * grid.outer_margin * beyond.abs().sum(-1)).sqrt()
    away = torch.linalg.vector_norm(torch.cat([beyond, free[:, None], beside[:, None]], dim=-1), dim=-1)
    outside = (beyond != 0).any(-1)
    value = torch.where(outside, value - free + grid.beyond * away, value)
    if not with_gradient:
        return value, None
    dy = along_y[0] + (along_y[1] - along_y[0]) * x
    square = along_z[0::2] + (along_z[1::2] - along_z[0::2]) * y
    dz = square[0] + (square[1] - square[0]) * x
    gradient = torch.stack([along_x, dy, dz], dim=-1) / grid.spacing
    # Along an axis on which a point was clamped the interpolant is constant, and only the way there changes.
    away = away.clamp_min(torch.finfo(points.dtype).tiny)
    share = torch.where(outside & (free > 0), free / away, 1.0).unsqueeze(-1)
    outward = grid.beyond * (beyond + grid.outer_margin * beyond.sign()) / away.unsqueeze(-1)
    return value, torch.where(beyond == 0, gradient * share, outward)


def _corners(values: Tensor, cell: Tensor) -> Tensor:
    """Values at the corners of cells ``[n, 3]`` as ``[8, n]``, in the order (x, y, z) = 000 001 010 ... 111."""
    _, ny, nz = values.shape
    base = (cell[:, 0] * ny + cell[:, 1]) * nz + cell[:, 2]
    steps = [dx * ny * nz + dy * nz + dz for dx in (0, 1) for dy in (0, 1) for dz in (0, 1)]
    index = base.unsqueeze(0) + base.new_tensor(steps).unsqueeze(1)
    return values.reshape(-1).index_select(0, index.reshape(-1)).reshape(8, -1)
