"""What checks look at: one motion at an even rate, what carries it, and how deep it is in things."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from objectives import Context
from objectives.library.scene import foot_heights
from scenectl.generators.prompts import Prompts
from scenectl.measures.believability.mass import shares
from scenectl.measures.metrics import Depths, Scorer
from scenes.motion.motion import Motion
from scenes.motion.skeleton import size_of

RATE = 20.0
"""Frames a second at which motions are differentiated: that of the recordings which the limits were measured on."""
GRAVITY = 9.81
TOES = 0.067
"""Metres from an adult's ball of the foot, where the proxy body ends, to the tip of the toes (ANSUR II: foot length
less ball of foot length)."""

Exemption = tuple[tuple[str, ...], tuple[tuple[float, float], ...] | None]
"""Joints (none: the whole body) that may touch the scene, and the windows (s) in which they may (None: always)."""
Support = tuple[tuple[str, ...], tuple[float, float] | None]
"""Joints whose part of the body rests on something, and from when to when (s; None: always)."""


@dataclass(frozen=True)
class Carried:
    """Low points of the body in every frame.

    Attributes:
        points: ends of feet first, then samples of all parts, ``[T, P, 3]`` (m).
        heights: of their surface over what is below, ``[T, P]`` (m).
        feet: how many of them belong to each foot, the left one's first.
    """

    points: np.ndarray
    heights: np.ndarray
    feet: int

    @property
    def lowest(self) -> np.ndarray:
        """Height (m) of the lowest point of the body, ``[T]``; 0 where it is in touch, or below."""
        return np.maximum(self.heights.min(axis=1), 0.0)

    def foot(self, side: int) -> np.ndarray:
        """Height (m) of the lowest point of a foot, 0 for the left one, ``[T]``."""
        return self.heights[:, side * self.feet : (side + 1) * self.feet].min(axis=1)


@dataclass(frozen=True, eq=False)
class Evidence:
    """One motion as checks see it: padding cropped, resampled to `RATE` where it has another.

    Attributes:
        given: the motion as it is, padding cropped, ``[T, J, 3]``.
        scorer: of its scene, with the body.
        prompt: the sentence that it shall show, or several with their times.
        exemptions: what may touch the scene.
        supports: what of the body is stated to rest on something.
        known: its depths, padding included, where they are known.
    """

    given: Motion
    scorer: Scorer
    prompt: Prompts | str = ""
    exemptions: tuple[Exemption, ...] = ()
    supports: tuple[Support, ...] = ()
    known: Depths | None = field(default=None, repr=False)

    @classmethod
    def of(
        cls,
        motion: Motion,
        scorer: Scorer,
        prompt: Prompts | str = "",
        exemptions: tuple[Exemption, ...] = (),
        supports: tuple[Support, ...] = (),
        depths: Depths | None = None,
    ) -> Evidence:
        """Evidence on a motion ``[T, J, 3]``, with padding or without."""
        real = motion.valid
        first = int(real.int().argmax()) if bool(real.any()) else 0
        given = replace(motion, joints=motion.joints[real], valid=real[real], t0=motion.t0 + first / motion.fps)
        if depths is not None:
            mask = real.cpu().numpy()
            depths = Depths(**{name: values[mask] for name, values in vars(depths).items()})
        return cls(given, scorer, prompt, exemptions, supports, depths)

    @property
    def size(self) -> float:
        """How many times as long the legs are as an adult's, whom limits are measured on."""
        return size_of(self.given.skeleton)

    @cached_property
    def depths(self) -> Depths:
        """Of `given`, per frame."""
        return self.scorer.depths(self.given) if self.known is None else self.known

    @cached_property
    def motion(self) -> Motion:
        """The motion at `RATE`, along cubic splines through its frames."""
        given = self.given
        if given.fps == RATE or given.frames < 2:
            return given
        from scipy.interpolate import CubicSpline  # 0.2 s to import, and most motions have this rate already

        times = np.arange(given.frames) / given.fps
        joints = CubicSpline(times, given.joints.detach().cpu().double().numpy())(
            np.arange(0, times[-1] + 1e-9, 1 / RATE)
        )
        return Motion(torch.from_numpy(joints).to(given.joints), fps=RATE, t0=given.t0, skeleton=given.skeleton)

    @cached_property
    def joints(self) -> np.ndarray:
        """Metres at `RATE`, ``[T, J, 3]`` float64."""
        joints: np.ndarray = self.motion.joints.detach().cpu().double().numpy()
        return joints

    @property
    def frames(self) -> int:
        """At `RATE`."""
        return len(self.joints)

    @cached_property
    def times(self) -> np.ndarray:
        """Seconds on the task's clock at `RATE`, ``[T]``."""
        return self.motion.t0 + np.arange(self.frames) / RATE

    def joint(self, name: str) -> np.ndarray:
        """Positions of a joint at `RATE`, ``[T, 3]``."""
        joint: np.ndarray = self.joints[:, self.motion.skeleton.index(name)]
        return joint

    @cached_property
    def center(self) -> np.ndarray:
        """The centre of mass at `RATE`, ``[T, 3]``."""
        center: np.ndarray = np.einsum("j,tjd->td", shares(self.motion.skeleton), self.joints)
        return center

    @cached_property
    def load(self) -> np.ndarray:
        """What the ground must bear, in body weights, ``[T]``: 1 at rest, 0 in free fall.

        (g + a) / g, a the upward acceleration of the centre of mass; never less than 0.
        """
        return np.maximum(1.0 + self.pushed[:, 1], 0.0)

    @cached_property
    def pushed(self) -> np.ndarray:
        """Acceleration of the centre of mass by second differences, ``[T, 3]``, in g; 0 where there are too few frames.

        The first and the last frame have that of their neighbour.
        """
        if self.frames < 3:
            return np.zeros_like(self.center)
        inner = np.diff(self.center, n=2, axis=0) * (RATE**2 / GRAVITY)
        return np.concatenate([inner[:1], inner, inner[-1:]])

    @cached_property
    def carried(self) -> Carried:
        """What is low, and how high it is over the ground; over what moves as well, for feet."""
        body, motion = self.scorer.body, self.motion
        samples, radii = body.points(motion)
        feet, over, toes = [], [], TOES * body.size
        context = Context(self.scorer.scene, body)
        for side in ("left", "right"):
            heel = next(
                body.parts.index(f"{side}_{part}") for part in ("heel", "ankle") if f"{side}_{part}" in body.parts
            )
            ankle, ball = motion.joint(f"{side}_ankle"), motion.joint(f"{side}_foot")
            along = torch.nn.functional.normalize(ball - ankle, dim=-1)
            flat = along * along.new_tensor([1.0, 0.0, 1.0])
            points = torch.stack([ball, samples[:, heel]], dim=1)
            heights = foot_heights(points, motion, context) + body.sole_offset
            heights = heights - torch.stack([radii.new_tensor(body.sole_offset), radii[heel]])
            # Toes stay flat or point like the foot: they reach below the ball where it is steeper than it mostly is.
            steeper = (along[:, 1].median() - along[:, 1]).clamp_min(0.0)
            feet += [points, (ball + toes * flat)[:, None]]
            over += [heights, (heights[:, 0] - toes * steeper)[:, None]]
        heights = self._held(samples[..., 1] - radii - self.scorer.scene.ground_under(samples))
        low = torch.cat([*over, heights], dim=1).detach().cpu().double().numpy()
        return Carried(torch.cat([*feet, samples], dim=1).detach().cpu().double().numpy(), low, 3)

    def _held(self, heights: Float[Tensor, "T M"]) -> Float[Tensor, "T M"]:
        """Heights of samples over what is below; of those that are stated to rest on something, over that if nearer."""
        names = self.given.skeleton.names
        owners, whose = np.array(self.scorer.body.owners), np.array([names[joint] for joint in self.scorer.owners])
        for joints, window in self.supports:
            begin, end = (-np.inf, np.inf) if window is None else window
            rows = np.flatnonzero((self.times >= begin - 1e-6) & (self.times <= end + 1e-6))
            given = np.rint((self.times[rows] - self.given.t0) * self.given.fps).astype(int)
            for joint in joints:
                rooms = self.depths.rooms[given.clip(0, self.given.frames - 1)][:, whose == joint]
                over = np.maximum(rooms.min(axis=1, initial=np.inf), 0.0)
                for sample in np.flatnonzero(owners == joint):
                    heights[rows, sample] = torch.minimum(heights[rows, sample], torch.from_numpy(over).to(heights))
        return heights

    @cached_property
    def velocities(self) -> np.ndarray:
        """Of joints from frame to frame at `RATE`, m/s, ``[T - 1, J, 3]``."""
        return np.diff(self.joints, axis=0) * RATE


def averages(values: np.ndarray, seconds: float) -> np.ndarray:
    """Means over windows of so many seconds along the first axis, of all of it where it is shorter."""
    size = min(round(seconds * RATE), len(values))
    sums = np.cumsum(np.concatenate([np.zeros_like(values[:1], dtype=np.float64), values]), axis=0)
    means: np.ndarray = (sums[size:] - sums[:-size]) / size
    return means


def longest_run(flags: np.ndarray) -> tuple[int, int]:
    """First of the longest runs of True: its beginning and its length, (0, 0) for none."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    if not len(edges):
        return 0, 0
    begins, ends = edges[::2], edges[1::2]
    best = int((ends - begins).argmax())
    return int(begins[best]), int(ends[best] - begins[best])
