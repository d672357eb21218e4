"""Conditions: goals as plain numbers, for families whose networks take them as inputs.

A guide can state any differentiable goal; a network that was trained on targets takes those alone. Conditions are
what the terms and the walk of a task say about joints at times, in the world frame. Families without such inputs
ignore them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from scenes.motion.skeleton import HUMANML3D, Skeleton


@dataclass(frozen=True)
class Conditions:
    """K statements, each about one joint at one time; what a statement leaves open is masked.

    Attributes:
        times: seconds of the motion.
        joints: index of the joint in the skeleton.
        positions: of the joint, world m; 0 where masked.
        directions: unit vectors along the bone that ends in the joint, world; 0 where masked.
        fronts: unit vectors along the z axis of the joint's rotation, world; 0 where masked.
        rotations: of the joint, world, unit quaternions w, x, y, z; (1, 0, 0, 0) where masked.
        contacts: 1 where the joint shall stand on something.
        position_mask: the coordinates that are stated: a place on the floor leaves y open.
        front_mask: likewise: where y is open, the front has that heading.
        direction_mask, rotation_mask, contact_mask: whether each is stated.
        skeleton: whose joints they are.
    """

    times: Float[Tensor, " K"]
    joints: Int[Tensor, " K"]
    positions: Float[Tensor, "K 3"]
    directions: Float[Tensor, "K 3"]
    fronts: Float[Tensor, "K 3"]
    rotations: Float[Tensor, "K 4"]
    contacts: Float[Tensor, " K"]
    position_mask: Bool[Tensor, "K 3"]
    direction_mask: Bool[Tensor, " K"]
    front_mask: Bool[Tensor, "K 3"]
    rotation_mask: Bool[Tensor, " K"]
    contact_mask: Bool[Tensor, " K"]
    skeleton: Skeleton = HUMANML3D

    @classmethod
    def none(cls, times: Float[Tensor, " K"], joints: Int[Tensor, " K"], skeleton: Skeleton = HUMANML3D) -> Conditions:
        """About those joints at those times, and nothing stated of them."""
        count = len(times)
        zeros, none = times.new_zeros(count, 3), torch.zeros(count, 3, dtype=torch.bool, device=times.device)
        return cls(
            times=times,
            joints=joints,
            positions=zeros,
            directions=zeros,
            fronts=zeros,
            rotations=times.new_tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1),
            contacts=zeros[:, 0],
            position_mask=none,
            direction_mask=none[:, 0],
            front_mask=none,
            rotation_mask=none[:, 0],
            contact_mask=none[:, 0],
            skeleton=skeleton,
        )

    def stating(self, what: str, which: slice, values: Float[Tensor, "n d"]) -> Conditions:
        """The same, where some statements are stated to be such values; what is not a number is left open.

        Args:
            what: "positions", "directions", "fronts" or "rotations".
            which: of the K statements, n.
            values: as the field has them.
        """
        mask = f"{what[:-1]}_mask"
        kept, known = getattr(self, what).clone(), getattr(self, mask).clone()
        stated = values.isfinite()
        kept[which] = torch.where(stated, values, kept[which])
        known[which] = stated if known.ndim == 2 else stated.all(-1)
        return replace(self, **{what: kept, mask: known})

    def __len__(self) -> int:
        return len(self.times)

    def position_signal(self, frames: int, fps: float) -> tuple[Float[Tensor, "T J 3"], Bool[Tensor, "T J 3"]]:
        """Positions on a motion's frames and the mask of what is stated, as control networks take them.

        A statement counts at the frame nearest to its time; those beyond the motion are left out.
        """
        at = (self.times * fps).round().long()
        inside = (at >= 0) & (at < frames)
        where = at[inside], self.joints[inside]
        shape = (frames, len(self.skeleton.names), 3)
        signal, mask = self.positions.new_zeros(shape), self.position_mask.new_zeros(shape)
        signal[where], mask[where] = self.positions[inside], self.position_mask[inside]
        return signal, mask
