"""What a motion is scored by, whatever its goals were: skating, acceleration, penetration, soles, bones.

Penetration comes from the triangles themselves (`Scene.distance_exact`), never from the grid that guided the motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from scenes.body.body import DEFAULT_BODY, ProxyBody
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Plane
from scenes.mesh.surface import Surface
from scenes.motion.bones import bone_lengths
from scenes.motion.headings import heading, turned
from scenes.motion.motion import Motion
from scenes.motion.skeleton import FEET, size_of
from scenes.world.scene import SAME, Scene

FLOOR_BAND = 0.06
"""Level triangles within this height of the floor (m) are floor and not obstacle: scans, rugs and thresholds."""
BESIDE = 0.1
"""Metres from the body's surface from which on a scorer of what was baked leaves triangles alone: what rests on
something is within half of that (`scenectl.measures.believability.judge.SUPPORTED`). Ours."""
SHALLOW = 0.01
"""A frame counts as touching when something is deeper than this (m)."""


def skating_ratio(motion: Motion, ground: float | Float[Tensor, "*b T 2"] = 0.0) -> Float[Tensor, "*b"]:
    """Share of transitions in which a foot slides, by the definition of guided motion diffusion (GMD).

    A foot skates from t to t+1 when its joint is lower than 0.05 m in both frames and moves faster than 0.5 m/s in the
    plane, both at that moment and averaged over five transitions (zeros beyond the ends); either foot counts. For
    bodies of another size both are in proportion to the legs. Frames that are padding are cropped first. Rounded to
    four decimals per sample, as published figures are.

    Args:
        motion: world coordinates; valid frames come first.
        ground: height (m) of the canonical frame's y = 0, i.e. of the lowest foot joint of a standing person; one, or
            one for each foot in each frame.
    """
    feet, size = motion.select(FEET), size_of(motion.skeleton)
    real = motion.valid[..., 1:] & motion.valid[..., :-1]
    speed = (feet[..., 1:, :, :] - feet[..., :-1, :, :])[..., [0, 2]].norm(dim=-1) * motion.fps
    speed = speed.transpose(-1, -2) * real[..., None, :]  # [*b, 2, T-1]
    flat = speed.reshape(-1, 1, speed.shape[-1])
    average = torch.nn.functional.avg_pool1d(flat, 5, stride=1, padding=2).reshape(speed.shape)
    low = (feet[..., 1] - ground < 0.05 * size).transpose(-1, -2)
    skates = low[..., 1:] & low[..., :-1] & (speed > 0.5 * size) & (average > 0.5 * size)
    count = (skates.any(dim=-2) & real).sum(-1)
    return (count / real.sum(-1).clamp_min(1)).round(decimals=4)


def max_acceleration(motion: Motion) -> Float[Tensor, "*b"]:
    """Largest second difference of any joint over the valid frames, m/frame^2 (x fps^2 = m/s^2)."""
    if motion.frames < 3:
        return motion.joints.new_zeros(motion.joints.shape[:-3])
    return _largest_accelerations(motion).amax(dim=-1)


def _largest_accelerations(motion: Motion) -> Float[Tensor, "*b _T"]:
    """Of the frames but the first and the last the largest second difference of any joint, m/frame^2; 0 in padding."""
    joints, valid = motion.joints, motion.valid
    second = (joints[..., 2:, :, :] - 2 * joints[..., 1:-1, :, :] + joints[..., :-2, :, :]).norm(dim=-1).amax(dim=-1)
    real = valid[..., 2:] & valid[..., 1:-1] & valid[..., :-2]
    return torch.where(real, second, 0.0)


SEAM = 0.25
"""Seconds on either side of a seam that belong to it."""


def seam_ratio(motion: Motion, seams: Sequence[float]) -> float:
    """How much more jerkily one motion, ``[T, J, 3]``, moves at seams (s) than elsewhere.

    Of each frame's largest acceleration of a joint, the largest within `SEAM` of a seam over the 99th percentile of all
    other frames; NaN where there are none of either, or nothing moves.
    """
    if motion.frames < 3:
        return math.nan
    peaks, real = _largest_accelerations(motion), motion.valid[1:-1]
    times = torch.arange(1, motion.frames - 1, device=peaks.device) / motion.fps
    near = ((times[:, None] - times.new_tensor(list(seams))).abs() <= SEAM + 1e-6).any(-1)
    at, elsewhere = peaks[real & near], peaks[real & ~near]
    if not len(at) or not len(elsewhere) or not bool(elsewhere.any()):
        return math.nan
    return float(at.max() / elsewhere.quantile(0.99))


def pose_change(before: Motion, after: Motion) -> Float[Tensor, "*b"]:
    """Mean distance (m) by which joints moved as seen from the pelvis, whichever way it faces; valid frames only.

    Small where refinement left poses as the generator made them, wherever it took the body.
    """
    moved = (_seen_from_pelvis(after) - _seen_from_pelvis(before)).norm(dim=-1).mean(-1)
    real = before.valid & after.valid
    return torch.where(real, moved, 0.0).sum(-1) / real.sum(-1).clamp_min(1)


def _seen_from_pelvis(motion: Motion) -> Float[Tensor, "*b T J 3"]:
    away = motion.joints - motion.joint("pelvis")[..., None, :]
    return turned(away, -heading(motion, ("hip",))[..., None])


def bone_length_drift(motion: Motion) -> Float[Tensor, "*b"]:
    """Largest deviation (m) of any bone from its own median length over the valid frames."""
    lengths = bone_lengths(motion)
    real = motion.valid[..., None].expand_as(lengths)
    median = torch.where(real, lengths, torch.nan).nanmedian(dim=-2, keepdim=True).values
    return torch.where(real, (lengths - median).abs(), 0.0).amax(dim=(-2, -1))


def lowest_sole(
    motion: Motion, floor: float | Float[Tensor, "*b T 2"], body: ProxyBody = DEFAULT_BODY
) -> Float[Tensor, "*b"]:
    """Height (m) of the lowest sole over the floor in any valid frame; negative when it sinks in.

    The floor's height is one, or one for each foot in each frame.
    """
    height = (motion.select(FEET)[..., 1] - body.sole_offset - floor).amin(dim=-1)
    return torch.where(motion.valid, height, torch.inf).amin(dim=-1)


def travelled(motion: Motion) -> Float[Tensor, "*b"]:
    """Length (m) of the pelvis's way over the floor, valid frames only."""
    steps = motion.joint("pelvis")[..., [0, 2]].diff(dim=-2).norm(dim=-1)
    return (steps * (motion.valid[..., 1:] & motion.valid[..., :-1])).sum(-1)


@dataclass(frozen=True)
class Depths:
    """How deep the body is in things, per frame.

    Attributes:
        obstacles: metres, ``[T]``, 0 where nothing but the floor is touched.
        floor: metres, ``[T]``, 0 where the floor is not entered.
        part: index of the deepest sample in obstacles in each frame, ``[T]``.
        clearance: smallest distance (m) from the body's surface to any obstacle, ``[T]``; negative inside.
        beyond: how far (m) the body's farthest part is outside of the free space that its first frame is connected to,
            by the way back of its middle, ``[T]``; 0 within.
        rooms: distance (m) from the surface of every sample to any obstacle, ``[T, M]``; negative inside.
        sunk: depth (m) of every sample in the floor, ``[T, M]``.
    """

    obstacles: np.ndarray
    floor: np.ndarray
    part: np.ndarray
    clearance: np.ndarray
    beyond: np.ndarray
    rooms: np.ndarray
    sunk: np.ndarray


@dataclass(frozen=True, eq=False)
class Scorer:
    """Penetration of bodies into one scene, exactly. Make one per scene: it prepares the triangles once.

    Capsules are sampled every quarter of their radius, which misses less than 1 % of it (0.2 % on flat surfaces).

    Attributes:
        scene, body: which ones.
        baked: signs and depths are those of what was baked, for those who look at many motions; where nothing is near,
            rooms are no more than what is free at least.
    """

    scene: Scene
    body: ProxyBody = DEFAULT_BODY
    baked: bool = False

    def depths(self, motion: Motion) -> Depths:
        """Depth of the body in obstacles and in the floor for every frame of one motion, ``[T, J, 3]``.

        An obstacle is every primitive, every object that moves, where it is at each frame's time, and every triangle of
        a mesh that is not a level piece at the height of the floor; and all that is beyond the free space in which the
        motion starts, as deep as the way back is long.
        Frames that are padding are 0 deep.
        """
        points = self.points(motion.joints.detach().cpu().double().numpy())
        frames, count, _ = points.shape
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        times = np.repeat(motion.times.cpu().double().numpy(), count)
        radii = np.tile(self._radii, frames)
        everything = self._distance(flat, times) - radii
        obstacles = self._obstacle_distance(flat, times, everything + radii, radii) - radii
        reach = self.scene.reached_from(_stand(motion)).reach
        beyond = np.zeros(len(flat)) if reach is None else reach.depth(flat)
        out = np.where(beyond > 0, -beyond - radii, np.inf)
        everything, obstacles = np.minimum(everything, out), np.minimum(obstacles, out).reshape(frames, count)
        deep_obstacle = np.maximum(-obstacles, 0.0)
        deep_all = np.maximum(-everything, 0.0).reshape(frames, count)
        deep_floor = np.where(deep_all > deep_obstacle + 1e-6, deep_all, 0.0)
        real = motion.valid.cpu().numpy()
        return Depths(
            deep_obstacle.max(axis=1) * real,
            deep_floor.max(axis=1) * real,
            obstacles.argmin(axis=1),
            np.where(real, obstacles.min(axis=1), np.inf),
            beyond.reshape(frames, count).max(axis=1) * real,
            np.where(real[:, None], obstacles, np.inf),
            deep_floor * real[:, None],
        )

    def points(self, joints: np.ndarray) -> np.ndarray:
        """Samples of the body's surface (m), ``[T, J, 3] -> [T, M, 3]``; each stands for a sphere of `radii`."""
        found: np.ndarray = self._weights @ joints
        return found

    @property
    def radii(self) -> np.ndarray:
        """Metres, ``[M]``."""
        return self._radii

    def room(self, points: np.ndarray, times: np.ndarray, samples: np.ndarray) -> np.ndarray:
        """Distance (m) from the surface of samples of those numbers, at points and times (s), to any obstacle."""
        points, radii = np.ascontiguousarray(points), self._radii[samples]
        return self._obstacle_distance(points, times, self._distance(points, times), radii) - radii

    def ground(self, motion: Motion) -> Float[Tensor, "*b T 2"]:
        """Height (m) of the ground under each foot in each frame: of the floor, a step or the storey that one is on."""
        return self.scene.ground_under(motion.select(FEET))

    def part(self, sample: int) -> str:
        """Name of the body part that a sample of `Depths.part` belongs to."""
        return self._parts[sample]

    @property
    def owners(self) -> list[int]:
        """Index of the joint that is nearest to each sample: the one to exempt."""
        return [int(joint) for joint in np.abs(self._weights).argmax(axis=1)]

    @property
    def parts(self) -> list[str]:
        """What every sample belongs to: a joint, a bone such as "left_hip-left_knee", or "left_palm"."""
        return list(self._parts)

    def _distance(self, points: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Signed distance (m) to everything, the floor included."""
        if not self.baked:
            return self.scene.distance_exact(points, times)
        with torch.no_grad():
            found: np.ndarray = self.scene.distance(torch.from_numpy(points), torch.from_numpy(times)).numpy()
        return found

    def _obstacle_distance(
        self, points: np.ndarray, times: np.ndarray, signed: np.ndarray, radii: np.ndarray
    ) -> np.ndarray:
        """Signed distance (m) from centres of spheres to obstacles; `signed` is that to everything and the floor."""
        tensor, when = torch.from_numpy(points), torch.from_numpy(times)
        best = np.full(len(points), np.inf)
        for shape in self.scene.primitives:
            if not isinstance(shape, Plane):
                best = np.minimum(best, shape.distance(tensor, when).numpy())
        for thing in self.scene.objects:
            best = np.minimum(best, thing.distance_exact(points, times))
        # Below the floor everything is solid; only above it does a negative sign mean the inside of an obstacle.
        inside = (signed < 0) & (points[:, 1] > self.scene.floor.height) & (best > 0)
        if self.surfaces:
            unsigned, near = np.abs(signed), signed - radii < BESIDE if self.baked else np.ones(len(points), dtype=bool)
            unsigned[near] = np.minimum.reduce([one.unsigned_distance(points[near]) for _, one in self.surfaces])
            best = np.minimum(best, np.where(inside, -unsigned, unsigned))
        for name, give in self.scene.soft.items():
            part = self.scene.part(name).distance_exact(points, times)
            best = np.where(part <= best + SAME, part + give, best)
        return best

    def within(self, scene: Scene) -> Scorer:
        """The same for a scene whose objects alone differ, so that its triangles are not prepared again."""
        if scene is self.scene:
            return self
        found = replace(self, scene=scene)
        if [mesh.digest for mesh in scene.meshes] == [mesh.digest for mesh in self.scene.meshes]:
            vars(found)["surfaces"] = self.surfaces
        return found

    @cached_property
    def surfaces(self) -> tuple[tuple[str, Surface], ...]:
        """The meshes' names and triangles without those that are floor."""
        found = []
        for mesh in self.scene.meshes:
            faces = mesh.faces[~_is_floor(mesh, self.scene.floor.height)]
            if len(faces):
                found.append((mesh.name, Surface.of(Mesh(mesh.vertices, faces, mesh.name, mesh.source))))
        return tuple(found)

    @cached_property
    def _samples(self) -> tuple[np.ndarray, np.ndarray, list[str]]:
        body, names = self.body, self.body.skeleton.names
        rows: list[tuple[dict[int, float], float, str]] = []
        for s in body.spheres:
            blend = {s.joint: 1.0} if s.base < 0 else {s.joint: 1.0 + s.beyond, s.base: -s.beyond}
            rows.append((blend, s.radius, s.name))
        for c in body.capsules:
            count = max(2, math.ceil(1.1 * float(body.skeleton.bone_lengths[c.b]) / (0.25 * c.radius)))
            for share in np.linspace(0.0, 1.0, count + 1)[1:-1]:  # at its ends are the joints' spheres
                rows.append(({c.a: 1.0 - share, c.b: float(share)}, c.radius, f"{names[c.a]}-{names[c.b]}"))
        weights = np.zeros((len(rows), len(names)))
        for m, (blend, _, _) in enumerate(rows):
            for joint, weight in blend.items():
                weights[m, joint] += weight
        return weights, np.array([row[1] for row in rows]), [row[2] for row in rows]

    @property
    def _weights(self) -> np.ndarray:
        return self._samples[0]

    @property
    def _radii(self) -> np.ndarray:
        return self._samples[1]

    @property
    def _parts(self) -> list[str]:
        return self._samples[2]


def _stand(motion: Motion) -> tuple[float, float, float]:
    """Where (m) one motion stands in its first frame: under its pelvis, as high as its lower foot."""
    x, _, z = motion.joint("pelvis")[0].tolist()
    return x, float(motion.select(FEET)[0, :, 1].min()), z


def _is_floor(mesh: Mesh, height: float) -> np.ndarray:
    """True for the triangles that are floor: level, and wholly within `FLOOR_BAND` of its height."""
    corners = mesh.vertices[mesh.faces]
    near = (np.abs(corners[:, :, 1] - height) <= FLOOR_BAND).all(axis=1)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    level = np.abs(normals[:, 1]) >= 0.5 * lengths
    flat: np.ndarray = near & level
    return flat


def measure(motion: Motion, scorer: Scorer, depths: Depths | None = None) -> dict[str, float | str | None]:
    """Every figure of this module for one motion, ``[T, J, 3]``: metres, seconds, ratios.

    `deepest_penetration_m` is of obstacles and of what is beyond the free space that the motion starts in (the latter
    alone is `beyond_free_space_m`); `deepest_at_s` and `deepest_part` say when and with what. `depths` are the motion's
    where they are known.
    """
    ground, body = scorer.ground(motion), scorer.body
    depths = scorer.depths(motion) if depths is None else depths
    frame = int(depths.obstacles.argmax())
    deepest = float(depths.obstacles[frame])
    real = motion.valid.cpu().numpy()
    clearance = float(depths.clearance.min())
    return {
        "deepest_penetration_m": deepest,
        "deepest_at_s": float(motion.times[frame]) if deepest > 0 else None,
        "deepest_part": scorer.part(int(depths.part[frame])) if deepest > 0 else None,
        "clearance_m": clearance if math.isfinite(clearance) else None,
        "beyond_free_space_m": float(depths.beyond.max()),
        "deepest_floor_penetration_m": float(depths.floor.max()),
        "share_of_frames_touching": float(
            (np.maximum(depths.obstacles, depths.floor)[real] > SHALLOW).mean() if real.any() else 0.0
        ),
        "lowest_sole_m": float(lowest_sole(motion, ground, body)),
        "skating_ratio": float(skating_ratio(motion, ground + body.sole_offset)),
        "max_acceleration_m_per_frame2": float(max_acceleration(motion)),
        "bone_length_drift_m": float(bone_length_drift(motion)),
        "path_length_m": float(travelled(motion)),
    }
