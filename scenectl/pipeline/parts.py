"""Parts of a motion: windows that an editor makes at once, and the whole motion as goals see it meanwhile."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from scenectl.generators.base import Guide, Step
from scenectl.generators.steps import AroundStep
from scenes.motion.motion import Motion

CONTEXT = 40
"""Known frames (2 s at 20 fps) that a window begins with, or ends with where it is made backwards: a whole stride, as
neighbouring windows of a long motion share (`scenectl.generators.mscot.keeping.OVERLAP`)."""
MARGIN = 20
"""Frames at the open end of a window that the next one makes again, for they were made without knowing how it goes on:
as many as a seam's jump dies away over (`scenectl.pipeline.seams.SETTLE`)."""


@dataclass(frozen=True)
class Window:
    """A part of a motion that an editor makes at once.

    Attributes:
        start, end: frames, the last one excluded.
        inside: which of its frames are not known yet, ``[end - start]``.
        taken: those of them that stay as they are made.
        gap: last frame before and first frame after the run that goes on beyond the window, where both are known.
    """

    start: int
    end: int
    inside: Bool[Tensor, " n"]
    taken: Bool[Tensor, " n"]
    gap: tuple[int, int] | None = None

    def of(self, motion: Motion) -> Motion:
        """That part of a motion ``[*b, T, J, 3]``."""
        t0 = motion.t0 + self.start / motion.fps
        joints, valid = motion.joints[..., self.start : self.end, :, :], motion.valid[..., self.start : self.end]
        return replace(motion, joints=joints, valid=valid, t0=t0)

    def toward(self, motion: Motion) -> Float[Tensor, "2"] | None:
        """Where the pelvis shall be (x, z, m) in the last frame so that it can still come to where the gap ends.

        On the line between the gap's ends, as far along it as the time; None where no gap goes on.
        """
        if self.gap is None:
            return None
        before, after = self.gap
        ends = motion.joint("pelvis")[[before, after]][:, [0, 2]]
        return torch.lerp(ends[0], ends[1], (self.end - 1 - before) / (after - before))

    def put(self, motion: Motion, made: Float[Tensor, "S n J 3"], frames: Bool[Tensor, " n"] | None = None) -> Motion:
        """A motion ``[T, J, 3]`` with what was made in its place, by default what is taken: ``[S, T, J, 3]``."""
        at = self.taken if frames is None else frames
        joints = motion.joints.to(made).expand(len(made), -1, -1, -1).clone()
        joints[:, self.start + torch.nonzero(at).flatten()] = made[:, at]
        return replace(motion, joints=joints, valid=motion.valid.expand(joints.shape[:2]))


def windows_over(regenerate: Bool[Tensor, " T"], longest: int) -> Iterator[Window]:
    """Windows of at most so many frames in which all that is not kept is made, each of them with known frames.

    Each begins with known frames where the part to be made has any before it, and ends with them otherwise.
    """
    total, left = len(regenerate), regenerate.clone()
    length = min(longest, total)
    while left.any():
        begin, end = _run(left)
        around = max(CONTEXT, (length - (end - begin)) // 2)
        start = begin - around if begin > 0 else end + around - length
        start = max(0, min(start, total - length))
        inside, taken = left[start : start + length].clone(), left[start : start + length].clone()
        gap = None
        if start + length < total and inside[-1]:
            taken[-MARGIN:] = False
            gap = (begin - 1, end) if begin > 0 and start + length <= end < total else None
        if start > 0 and inside[0]:
            taken[:MARGIN] = False
        left[start : start + length] &= ~taken
        yield Window(start, start + length, inside, taken, gap)


def _run(left: Bool[Tensor, " T"]) -> tuple[int, int]:
    """First frame and end of the first run of frames that are not known."""
    begin = int(left.int().argmax())
    known = torch.nonzero(~left[begin:]).flatten()
    return begin, begin + int(known[0]) if len(known) else len(left)


@dataclass(frozen=True)
class PartStep(AroundStep):
    """A step that decodes a window of a motion, seen as a step that decodes the motion.

    Attributes:
        inner: the step as its generator made it.
        whole: the motion ``[T, J, 3]``, of which the window's unknown frames are of no account.
        window: which part the step makes.
    """

    inner: Step
    whole: Motion
    window: Window

    @property
    def value(self) -> Float[Tensor, "S *v"]:
        return self.inner.value

    def decode(self, value: Float[Tensor, "S *v"]) -> Motion:
        return self._put(self.inner.decode(value))

    def at(self, value: Float[Tensor, "S *v"]) -> PartStep:
        return replace(self, inner=self.inner.at(value))

    def take(self, samples: Int[Tensor, " s"]) -> PartStep:
        return replace(self, inner=self.inner.take(samples))

    @property
    def motion(self) -> Motion:
        return self._put(self.inner.motion)

    def jvp(self, tangent: Float[Tensor, "S *v"]) -> Float[Tensor, "S T J 3"]:
        still = replace(self.whole, joints=torch.zeros_like(self.whole.joints))
        return self.window.put(still, self.inner.jvp(tangent), self.window.inside).joints

    def vjp(self, cotangent: Float[Tensor, "S T J 3"]) -> Float[Tensor, "S *v"]:
        return self.inner.vjp(self._cut(cotangent))

    def vjps(self, cotangents: Float[Tensor, "R S T J 3"]) -> Float[Tensor, "R S *v"]:
        return self.inner.vjps(self._cut(cotangents))

    def _put(self, made: Motion) -> Motion:
        return self.window.put(self.whole, made.joints, self.window.inside)

    def _cut(self, cotangents: Float[Tensor, "*b T J 3"]) -> Float[Tensor, "*b n J 3"]:
        part = cotangents[..., self.window.start : self.window.end, :, :]
        return part * self.window.inside[:, None, None]


@dataclass(frozen=True)
class PartGuide:
    """A guide that knows whole motions, asked about steps that decode a window of one.

    Attributes:
        whole_guide: the guide.
        whole: the motion ``[T, J, 3]``.
        window: which part the steps make.
    """

    whole_guide: Guide
    whole: Motion
    window: Window

    def log_prob(self, step: Step) -> Float[Tensor, " S"]:
        return self.whole_guide.log_prob(PartStep(step, self.whole, self.window))

    def gradient(self, step: Step) -> Float[Tensor, "S *v"]:
        return self.whole_guide.gradient(PartStep(step, self.whole, self.window))
