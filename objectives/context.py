"""What a goal may look at besides the motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from scenes.body.body import Segments
from scenes.motion.frames import HOME, Place
from scenes.motion.motion import Motion
from scenes.motion.skeleton import Skeleton


@runtime_checkable
class SceneLike(Protocol):
    """The part of `scenes.Scene` that goals use; anything that has it will do."""

    @property
    def bounds(self) -> object:
        """Lower and upper corner, metres, anything that numpy reads as ``[2, 3]``."""
        ...

    def distance(self, points: Tensor, time: Tensor | None = None) -> Tensor:
        """Signed distance in metres, positive in free space: ``[*b, 3] -> [*b]``; `time` in seconds broadcasts."""
        ...


@runtime_checkable
class Grounded(Protocol):
    """A scene that knows how high soles stand, which a `SceneLike` need not."""

    @property
    def ground(self) -> float | None:
        """Metres, world; None where it is not known."""
        ...


@runtime_checkable
class Layered(Protocol):
    """A scene that knows how high soles stand at each place, as on steps and slopes."""

    def ground_under(self, points: Tensor) -> Tensor:
        """Height (m, world) of the ground under points, nearest below: ``[*b, 3] -> [*b]``, without gradients."""
        ...


@runtime_checkable
class Parted(Protocol):
    """A scene whose parts have names, as nodes of a file do."""

    def part(self, name: str) -> SceneLike:
        """The part of that name alone; raises UserError for one that it does not have."""
        ...


@runtime_checkable
class BodyLike(Protocol):
    """The part of `scenes.ProxyBody` that goals use."""

    @property
    def skeleton(self) -> Skeleton:
        """The joints that it is made for, and their bones."""
        ...

    @property
    def owners(self) -> list[str]:
        """Joint whose sample each of the M points is."""
        ...

    @property
    def sole_offset(self) -> float:
        """Metres from the lowest foot joint down to the sole of a standing person."""
        ...

    def points(self, motion: Motion) -> tuple[Float[Tensor, "*b T M 3"], Float[Tensor, " M"]]:
        """Sample points (world, m) and their radii (m)."""
        ...

    def segments(self, motion: Motion) -> Segments:
        """The same body as whole capsules."""
        ...


@dataclass(frozen=True)
class Context:
    """What a goal may look at besides the motion.

    Attributes:
        scene: signed distances (m) at points and times.
        body: the proxy body that gives a motion its volume.
    """

    scene: SceneLike
    body: BodyLike

    def ground_under(self, points: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b"] | None:
        """Height (m, world) on which soles at points stand, where the scene knows it; without gradients."""
        if isinstance(self.scene, Layered):
            return self.scene.ground_under(points)
        ground = self.scene.ground if isinstance(self.scene, Grounded) else None
        return None if ground is None else torch.full_like(points[..., 0], ground, requires_grad=False)

    def give(self, part: str) -> float:
        """By how much (m) a named part of the scene gives, as a cushion does; 0 where none says so."""
        soft: dict[str, float] = getattr(self.scene, "soft", {})
        return soft.get(part, 0.0)

    @property
    def origin(self) -> Place:
        """Where in the world (m) the frame begins that the motion, the scene and all typed parameters are stated in.

        Scenes far from the world's origin are computed in a frame near them (`scenes.motion.frames.FAR`). A goal needs
        this only for coordinates of the world that it knows by itself.
        """
        origin: Place = getattr(self.scene, "origin", HOME)
        return origin

    @property
    def unbaked(self) -> Context:
        """The same with a plane for the scene's distances: asking a mesh for real ones bakes it, which takes long."""
        return replace(self, scene=_Unbaked(self.scene))


class _Unbaked:
    """A scene whose distances are heights over y = 0, and whose facts are another's."""

    def __init__(self, scene: SceneLike) -> None:
        self._scene = scene

    @property
    def bounds(self) -> object:
        return self._scene.bounds

    def distance(self, points: Tensor, time: Tensor | None = None) -> Tensor:
        return points[..., 1] if time is None else points[..., 1] + 0 * time

    def ground_under(self, points: Tensor) -> Tensor:
        return torch.zeros_like(points[..., 0])

    def __getattr__(self, name: str) -> Any:
        return getattr(self._scene, name)
