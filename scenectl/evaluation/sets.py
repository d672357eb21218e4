"""The sets of motions that an evaluation compares: real, reconstructed, of random tokens, generated."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.data.clips import ClipSet
from scenectl.data.features import FPS, body_joints, features_to_joints, joints_to_features, on_body
from scenectl.evaluation.motions import STRIDE
from scenectl.generators.base import Generator, Progress, silent
from scenectl.generators.spec import Spec
from scenectl.generators.steps import DecodedStep, LatentStep
from scenectl.training.errors import RoundTrip
from scenes.errors import UserError
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.skeleton import HUMANML3D

_ENDS = HUMANML3D.indices(("left_wrist", "right_wrist", "left_foot", "right_foot", "head"))


@runtime_checkable
class Tokenised(Protocol):
    """A generator of tokens, which can also write motions as tokens and read tokens without a sentence."""

    def round_trip(self, features: Float[Tensor, "C T 263"]) -> Float[Tensor, "C T 263"]:
        """Raw features after a round trip through tokens: the best that these tokens can do; T a multiple of four."""
        ...

    def round_trips(self, seen: Float[Tensor, "W T 263"]) -> Mapping[str, RoundTrip]:
        """The same through a part of what codes a motion, by name, from what is lost first on, to tell where it is.

        Args:
            seen: raw windows of training, on which what is no part of the generator may be fitted.
        """
        ...

    def from_random_tokens(self, frames: int, draw: torch.Generator) -> Float[Tensor, "1 T 263"]:
        """Raw features of tokens drawn uniformly: what a generator makes that has learnt nothing."""
        ...


@dataclass(frozen=True)
class HeldOut:
    """What is asked of a generator: a caption and a length for each test clip, and the clip itself.

    Attributes:
        features: raw features of each clip, cut to what a generator makes at once and to a multiple of four.
        captions: one of each clip's.
        kinds: kind of motion of each.
    """

    features: list[Float[Tensor, "_T 263"]]
    captions: list[str]
    kinds: list[str]

    @classmethod
    def of(cls, data: ClipSet, spec: Spec, seed: int, most: int | None = None) -> HeldOut:
        """All clips that are as long as a generator's shortest motion, or `most` of them at random.

        Raises:
            UserError: there is no such clip.
        """
        draw = torch.Generator().manual_seed(seed)
        order = torch.randperm(len(data.ids), generator=draw).tolist()
        shortest, longest = math.ceil(spec.shortest * FPS), round(spec.window * FPS)
        chosen = sorted([i for i in order if int(data.lengths[i]) >= shortest][:most])
        if not chosen:
            raise UserError(f"no test clip has {shortest} frames; evaluate on a folder with longer ones")
        features, captions = [], []
        for i in chosen:
            frames = min(int(data.lengths[i]), longest) // STRIDE * STRIDE
            features.append(data.features[data.starts[i] :][:frames])
            captions.append(data.captions[i][int(torch.randint(len(data.captions[i]), (), generator=draw))])
        return cls(features, captions, [data.groups[i] for i in chosen])

    def at_most(self, each: int) -> HeldOut:
        """The same with so many clips of each kind at most, taken at even steps."""
        kept: list[int] = []
        for kind in sorted(set(self.kinds)):
            mine = [i for i, found in enumerate(self.kinds) if found == kind]
            kept += [mine[i * len(mine) // each] for i in range(each)] if len(mine) > each else mine
        kept.sort()
        return HeldOut(
            [self.features[i] for i in kept], [self.captions[i] for i in kept], [self.kinds[i] for i in kept]
        )


@dataclass(frozen=True)
class MotionSet:
    """Motions of one origin, both as a viewer and as an evaluator sees them.

    Attributes:
        name: of the origin.
        joints: canonical positions of each, ``[T, 22, 3]`` metres.
        features: made from those joints, one row less.
        moved: how far (m) rigid bones took the ends of limbs from where a network had put them, of each motion.
    """

    name: str
    joints: list[Float[Tensor, "_T 22 3"]]
    features: list[Float[Tensor, "_T 263"]]
    moved: list[float] = field(default_factory=list)

    @classmethod
    def of(
        cls, name: str, joints: Sequence[Float[Tensor, "_T 22 3"]], loose: Sequence[Float[Tensor, "_T 22 3"]] = ()
    ) -> MotionSet:
        """All sets go from joints to features the same way, so that none is favoured.

        Args:
            name: of the origin.
            joints: canonical positions.
            loose: the same before bones were made rigid, where they were not.
        """
        pairs = zip(joints, loose, strict=True) if loose else ()
        moved = [float((after - before)[:, _ENDS].norm(dim=-1).mean()) for after, before in pairs]
        return cls(name, list(joints), [joints_to_features(j) for j in joints], moved)

    @property
    def padded(self) -> Motion:
        """All motions as one batch, padded behind."""
        joints = torch.nn.utils.rnn.pad_sequence(self.joints, batch_first=True)
        lengths = torch.tensor([len(j) for j in self.joints])
        return Motion(joints, torch.arange(joints.shape[1]) < lengths[:, None], fps=FPS)


@torch.no_grad()
def real(clips: HeldOut) -> MotionSet:
    """The clips themselves, on a generated body's bones: people's hips and collars differ, and no model is to be judged
    by that.
    """
    return MotionSet.of("real", [features_to_joints(on_body(f)) for f in clips.features])


@torch.no_grad()
def reconstructed(clips: HeldOut, round_trip: RoundTrip) -> MotionSet:
    """The clips after a round trip, such as that through tokens."""
    decoded = [round_trip(f[None]) for f in clips.features]
    return MotionSet.of(
        "reconstruction", [body_joints(f)[0] for f in decoded], [features_to_joints(f)[0] for f in decoded]
    )


@torch.no_grad()
def of_random_tokens(clips: HeldOut, generator: Tokenised, seed: int) -> MotionSet:
    """Motions of tokens drawn uniformly, as long as the clips."""
    draw = torch.Generator().manual_seed(seed)
    random = (generator.from_random_tokens(len(f), draw) for f in clips.features)
    return MotionSet.of("random tokens", [body_joints(features)[0] for features in random])


def generated(clips: HeldOut, generator: Generator, seed: int, progress: Progress = silent) -> MotionSet:
    """One motion for each clip, from its caption and of its length."""
    joints, loose = list[Tensor](), list[Tensor]()
    for i, (features, caption) in enumerate(zip(clips.features, clips.captions, strict=True)):
        progress("generating", i / len(clips.features))
        made = generator.generate(caption, len(features) / FPS, Pose2D(), seed=seed + i)
        joints.append(made.motion.joints[0])
        if isinstance(made.step, DecodedStep | LatentStep):
            loose.append(made.step.loose.joints[0])
    return MotionSet.of("generated", joints, loose)
