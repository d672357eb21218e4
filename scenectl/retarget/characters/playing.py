"""Motions on characters: rotations are copied, bones keep their length, feet are held where they stand.

A joint that is turned in the world by R against our T-pose turns its node from how it rests by R A^-1, where A is how
the character at rest is turned against its own T-pose (`Character.turned`): it does not matter how a joint's own axes
lie, or what the character rests in. Nodes without a joint of ours go with what they hang on.

The root goes as much further as the legs are longer, seen from the ground on which the motion starts, and so do places
where feet stand (`scenectl.retarget.characters.feet`). Where legs are too short for one, the pelvis goes down.
Hands are left where the rotations take them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from scenectl.retarget.characters.character import Character, apart, orthogonal
from scenectl.retarget.characters.feet import SIDES, Foot, Way
from scenectl.retarget.characters.limbs import STRETCH, bent, lowered
from scenectl.retarget.plants import Plant, plants
from scenes.mesh.gltf import Gltf
from scenes.motion.fitting import SAME
from scenes.motion.kinematics import carried, forward
from scenes.motion.motion import Motion
from scenes.motion.rotations import matrices, steady, unit_quaternions
from scenes.motion.skeleton import HUMANML3D, Skeleton

EASE = 0.2
"""Seconds in which a foot that was held comes back to where rotations take it: half a swing of a walk (D. A. Winter,
Biomechanics and Motor Control of Human Movement, 2009: 0.4 s at a natural cadence)."""

_AT = HUMANML3D.index


@dataclass(frozen=True, eq=False)
class Played:
    """What a character's nodes do.

    Attributes:
        rotations: by node, its local rotations as quaternions (w, x, y, z), without changes of sign, ``[T, 4]``.
        mover: the node that carries all of these.
        translations: by node, of the mover and of loose joints (`Character.loose`), in their parents' frames and units,
            ``[T, 3]``.
        joints: world positions (m) of our 22 joints on the character, ``[T, 22, 3]``.
        turns: world rotations of them, from rest, ``[T, 22, 3, 3]``.
        stands: where feet are held: joint, frames and the place (m) of the character's ankle or toe joint.
        ratio: of its legs to those of the motion's skeleton.
        lowered: by how much (m) the pelvis went down at most, for feet that were out of reach.
    """

    rotations: dict[int, Float[np.ndarray, "T 4"]]
    mover: int
    translations: dict[int, Float[np.ndarray, "T 3"]]
    joints: Float[np.ndarray, "T 22 3"]
    turns: Float[np.ndarray, "T 22 3 3"]
    stands: tuple[Plant, ...]
    ratio: float
    lowered: float

    def worlds(self, file: Gltf) -> Float[np.ndarray, "T N 4 4"]:
        """Transforms of all nodes of the character's file to the world, as whoever reads its animation finds them."""
        frames = np.zeros((len(self.joints), len(file.nodes), 4, 4))
        for node in file.order:
            place, turn, scale = apart(file.nodes[node])
            local = np.tile(np.eye(4), (len(frames), 1, 1))
            if node in self.rotations:
                turn = matrices(torch.from_numpy(self.rotations[node])).numpy()
            local[:, :3, :3] = turn * scale
            local[:, :3, 3] = self.translations.get(node, place)
            above = file.parents[node]
            frames[:, node] = local if above < 0 else frames[:, above] @ local
        return frames


def play(
    character: Character,
    skeleton: Skeleton,
    rotations: Float[np.ndarray, "T 22 4"],
    roots: Float[np.ndarray, "T 3"],
    fps: float,
    travels: bool = True,
) -> Played:
    """A motion on a character.

    A motion that was made for the character, on its skeleton, is played as it is: feet stand where they did.

    Args:
        character: who plays.
        skeleton: of the motion, of our 22 joints.
        rotations: of its joints, local, from the T-pose (w, x, y, z).
        roots: places of its pelvis (m).
        fps: frames a second.
        travels: whether the root walks, or stays over its first place; feet are turned as they are where it walks.
    """
    world = carried(torch.from_numpy(rotations), skeleton).numpy()
    figure = _Figure(character, world @ character.turned.transpose(0, 2, 1), roots)
    ratio = character.skeleton.legs / skeleton.legs
    own = np.abs(np.subtract(skeleton.offsets, character.skeleton.offsets)).max() <= SAME
    stands, down = list[Plant](), 0.0
    if not own:
        joints = forward(torch.from_numpy(rotations), torch.from_numpy(roots), skeleton)
        motion = Motion(joints, fps=fps, skeleton=skeleton)
        stands, down = figure.plant(motion, ratio)
    if not travels:
        figure.roots = figure.roots * [0.0, 1.0, 0.0] + figure.roots[:1] * [1.0, 0.0, 1.0]
    quaternions, translations = figure.locals()
    return Played(quaternions, character.mover, translations, figure.joints(), figure.turns, tuple(stands), ratio, down)


class _Figure:
    """A character in all frames of a motion, while it is posed: world rotations of its joints, and its pelvis."""

    def __init__(self, character: Character, turns: np.ndarray, roots: np.ndarray) -> None:
        self.character, self.turns, self.roots = character, turns, roots
        self.parents = character.file.parents
        self.named = {node: _AT(joint) for joint, node in character.joints.items()}

    def turn(self, node: int) -> np.ndarray:
        """World rotations of a node from rest, ``[T, 3, 3]``: its joint's, or of what it hangs on."""
        named = (self.named[above] for above in self.character.way(node) if above in self.named)
        joint = next(named, None if self.character.mover not in self.character.way(node) else 0)
        return np.broadcast_to(np.eye(3), (len(self.turns), 3, 3)) if joint is None else self.turns[:, joint]

    def at(self, node: int) -> np.ndarray:
        """World positions (m) of a node that hangs on the mover, ``[T, 3]``."""
        return self.roots + self._from_mover(node) - self._from_mover(self.character.joints["pelvis"])

    def _from_mover(self, node: int) -> np.ndarray:
        character, place = self.character, np.zeros_like(self.roots)
        while node != character.mover:
            parent = character.loose.get(node, self.parents[node])
            place = place + self.turn(parent) @ (character.origins[node] - character.origins[parent])
            node = parent
        return place

    def joints(self) -> np.ndarray:
        """World positions (m) of our 22 joints, ``[T, 22, 3]``: those without a node go with the one above."""
        found: list[np.ndarray] = []
        carriers: list[int] = []
        for j, name in enumerate(HUMANML3D.names):
            above = carriers[HUMANML3D.parents[j]] if j else 0
            named = name in self.character.joints
            carriers.append(j if named else above)
            if named and not name.endswith("_foot"):  # balls lie beside the character's own (`scenes.body.fit.placed`)
                found.append(self.at(self.character.joints[name]))
            else:
                found.append(
                    found[above] + self.turns[:, above] @ (self.character.place[j] - self.character.place[above])
                )
        return np.stack(found, axis=1)

    def plant(self, motion: Motion, ratio: float) -> tuple[list[Plant], float]:
        """Scale the way of the root and hold feet where they stand: where that is, and how far (m) the pelvis sank."""
        found = plants(motion)
        way = Way.of(motion, found, ratio)
        feet = [Foot.of(self.character, way, side) for side in SIDES]
        self.roots = way.place(self.roots, way.sole, float(np.mean([foot.ball for foot in feet])))
        window = max(round(EASE * motion.fps), 1)
        stands, targets, reach, hips = list[Plant](), [], [], []
        for foot in feet:
            hips.append(self.at(foot.hip))
            ankle = self.at(foot.ankle)
            held, target = foot.held(self.turns, ankle, found, window)
            stands += held
            targets.append(target)
            reach.append(np.clip(np.linalg.norm(ankle - hips[-1], axis=-1), STRETCH * foot.leg, foot.leg))
        down = lowered(np.stack(hips), np.stack(targets), np.stack(reach), window)
        self.roots = self.roots - down[:, None] * [0.0, 1.0, 0.0]
        for foot, target in zip(feet, targets, strict=True):
            hip, knee = _AT(f"{foot.side}_hip"), _AT(f"{foot.side}_knee")
            hinge = self.turns[:, hip] @ self.character.turned[hip][:, 0]
            swings = bent(self.at(foot.hip), self.at(foot.knee), self.at(foot.ankle), hinge, target)
            for joint, swing in zip((hip, knee), swings, strict=True):
                self.turns[:, joint] = swing @ self.turns[:, joint]
        return stands, float(down.max(initial=0.0))

    def locals(self) -> tuple[dict[int, np.ndarray], dict[int, np.ndarray]]:
        """Rotations of nodes that turn, against their parents, and places in them of those that move."""
        file, mover = self.character.file, self.character.mover
        moving = sorted({*self.named, mover}, key=file.order.index)
        turns = np.stack([self._local(node) for node in moving], axis=1)
        quaternions = steady(unit_quaternions(torch.from_numpy(turns))).numpy()
        translations = {node: self._place(node) for node in moving if node == mover or node in self.character.loose}
        return dict(zip(moving, quaternions.transpose(1, 0, 2), strict=True)), translations

    def _place(self, node: int) -> np.ndarray:
        """Positions of a node in its parent's frame, ``[T, 3]``."""
        file, above = self.character.file, self.parents[node]
        place = self.at(node)
        if above < 0:
            return place
        inverse = np.linalg.inv(file.world[above][:3, :3])
        if node == self.character.mover:  # what it hangs on stays
            moved: np.ndarray = (place - file.world[above][:3, 3]) @ inverse.T
            return moved
        moved = ((place - self.at(above))[:, None] @ self.turn(above))[:, 0] @ inverse.T
        return moved

    def _local(self, node: int) -> np.ndarray:
        """Rotations of a node in its parent's frame, ``[T, 3, 3]``."""
        file, above = self.character.file, self.parents[node]
        _, rest, _ = apart(file.nodes[node])
        if above < 0:
            return self.turn(node) @ rest
        frame = orthogonal(file.world[above][:3, :3])
        turned: np.ndarray = frame.T @ self.turn(above).swapaxes(1, 2) @ self.turn(node) @ frame @ rest
        return turned
