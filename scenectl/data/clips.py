"""Clips as features, with their augmented copies: loaded once, cut into windows, and measured on whole beginnings."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import torch
from jaxtyping import Float, Int
from safetensors import safe_open
from safetensors.torch import save
from torch import Tensor

from scenectl.data.augment import Augmentation, augmented
from scenectl.data.corpus import COLLECTION, CREDITS, Clip, load_motions, terms_of
from scenectl.data.features import FEATURES, FPS, GROUPS, joints_to_features
from scenectl.data.kinds import COMPOSED, kind_of
from scenectl.data.sentences import in_one
from scenes.errors import UserError
from scenes.files import atomic_write, sweep

_FORMAT = 14
"""Raised whenever prepared data must be made again."""

OFTEN = {
    COMPOSED: 3.0,
    "sit down": 3.0,
    "stand up": 3.0,
    "idle": 3.0,
    "squat": 3.0,
    "bandai: walk-turn-left": 3.0,
    "bandai: walk-turn-right": 3.0,
    "reach": 2.0,
    "pick up": 2.0,
    "put down": 2.0,
    "bandai: run": 2.0,
}
"""How many times as often as their size says some kinds are drawn. Nothing is harder to learn than several things in
one sentence, and every sequence shows several kinds; the others are those that `bench generator` recognised or
believed least often, and standing, which `bench idle` did not believe."""

_MOST = 2000
"""Clips that a measure looks at, at most: more change no figure that a card prints."""


class Told(NamedTuple):
    """A stretch of a clip and the sentences that say what happens in it.

    Attributes:
        begin, end: frames of the clip, up to and without `end`.
        captions: one of them says it.
        acts: how many things it shows one after another.
    """

    begin: int
    end: int
    captions: list[str]
    acts: int = 1


class Drawn(NamedTuple):
    """Windows of clips.

    Attributes:
        features: raw.
        clips: index of each window's clip.
        offsets: the window's first frame in its clip.
    """

    features: Float[Tensor, "B T 263"]
    clips: Int[Tensor, " B"]
    offsets: Int[Tensor, " B"]


@dataclass(frozen=True)
class ClipSet:
    """Clips as features, from which windows are drawn with a share for every kind of motion.

    Attributes:
        features: all clips one after the other, ``[N, 263]``.
        starts: first row of each clip, with N at the end, ``[C + 1]``.
        told: of each clip, what happens when: the whole first, then its acts and every run of several acts.
        groups: kind of motion of each clip, for balancing and reports.
        sources: data set of each clip.
        ids: names of the clips.
        licences: terms of each clip.
        commercial: whether each clip's terms allow commercial use.
    """

    features: Float[Tensor, "N 263"]
    starts: Int[Tensor, " C1"]
    told: list[list[Told]]
    groups: list[str]
    sources: list[str]
    ids: list[str]
    licences: list[str]
    commercial: list[bool]

    @classmethod
    def of(cls, features: Sequence[Float[Tensor, "_T 263"]], **columns: Any) -> ClipSet:
        """Clips with what stands in every other attribute, by its name."""
        starts = torch.tensor([0, *map(len, features)]).cumsum(0)
        return cls(torch.cat(list(features)), starts, **columns)

    @property
    def captions(self) -> list[list[str]]:
        """Sentences that say all that each clip shows."""
        return [stretches[0].captions for stretches in self.told]

    @cached_property
    def lengths(self) -> Int[Tensor, " C"]:
        """Rows of each clip."""
        return self.starts.diff()

    def on(self, device: torch.device) -> ClipSet:
        """The same with the features on another device, where windows are then cut; the rest stays on the CPU."""
        return replace(self, features=self.features.to(device))

    @property
    def hours(self) -> float:
        return len(self.features) / FPS / 3600

    @property
    def recorded_hours(self) -> float:
        """Hours without the augmented copies, whose names carry a suffix."""
        recorded = torch.tensor(["~" not in name for name in self.ids])
        return float(self.lengths[recorded].sum()) / FPS / 3600

    def statistics(self) -> tuple[Float[Tensor, "263"], Float[Tensor, "263"]]:
        """Mean of each feature, and its standard deviation averaged within each group of the layout."""
        mean = self.features.mean(0)
        std = self.features.std(0)
        for group in GROUPS:
            std[group] = std[group].mean()
        return mean, std.clamp_min(1e-5)  # what never changes would divide by zero

    def terms(self) -> tuple[str, list[str]]:
        """Licence of weights trained on these clips, and the terms of each source."""
        licence = "commercial use allowed, see the terms of the sources"
        if not all(self.commercial):
            licence = "non-commercial use only (part of the training data is CC BY-NC 4.0 or of unstated origin)"
        made = set(zip(self.sources, self.licences, strict=True))
        pairs = sorted({pair for source, licence in made for pair in terms_of(source, licence)})
        return licence, [f"{source}: {terms}. {CREDITS.get(source, '')}".rstrip() for source, terms in pairs]

    def draw(self, length: int, batch: int, generator: torch.Generator) -> Drawn:
        """Random windows ``[B, length, 263]`` of clips that are long enough.

        A group's share is the square root of its size: big groups lead, and small ones are still seen.
        """
        weights = self._weights(length)
        clips = torch.multinomial(weights, batch, replacement=True, generator=generator)
        slack = (self.lengths[clips] - length).double()
        offset = (torch.rand(batch, generator=generator, dtype=torch.float64) * (slack + 1)).long()
        rows = (self.starts[clips] + offset)[:, None] + torch.arange(length)
        return Drawn(self.features[rows.to(self.features.device)], clips, offset)

    def draw_any(self, lengths: Sequence[int], batch: int, generator: torch.Generator) -> Float[Tensor, "B T 263"]:
        """Random windows of one of several lengths, as many frames in all as `batch` windows of the first."""
        length = lengths[int(torch.randint(len(lengths), (), generator=generator))]
        return self.draw(length, max(1, batch * lengths[0] // length), generator).features

    def draw_length(self, shortest: int, longest: int, step: int, generator: torch.Generator) -> int:
        """Length of windows, from `shortest` to `longest` in steps: of a clip drawn as for `draw`, all of it or, as
        often, any part.

        Drawn evenly, few windows would be as short as the clips that show one act that is soon done.
        """
        clip = torch.multinomial(self._weights(shortest), 1, generator=generator)
        most = min(longest, int(self.lengths[clip])) // step
        part = int(torch.randint(shortest // step, most + 1, (), generator=generator))
        return step * (most if torch.rand((), generator=generator) < 0.5 else part)

    def _weights(self, length: int) -> Float[Tensor, " C"]:
        return weights(self.lengths, self.groups, length)


def weights(lengths: Int[Tensor, " C"], groups: Sequence[str], length: int) -> Float[Tensor, " C"]:
    """How often windows of `length` frames are drawn from each clip, relative to the others.

    Args:
        lengths: frames of the clips.
        groups: each clip's kind of motion.
        length: of the windows; shorter clips are not drawn.

    Raises:
        UserError: all are shorter.
    """
    room = (lengths - length + 1).clamp_min(0).float()
    if not bool((room > 0).any()):
        raise UserError(f"no clip of the training data has {length} frames; shorten the windows in the config")
    # Capped, or one long clip would outweigh all the short ones beside it.
    room = torch.where(room > 0, room.clamp_max(100.0) + length, room)
    names = {name: i for i, name in enumerate(sorted(set(groups)))}
    group = torch.tensor([names[name] for name in groups])
    size = torch.zeros(len(names)).index_add_(0, group, room)
    often = torch.tensor([OFTEN.get(name, 1.0) for name in names])
    return room / size[group].clamp_min(1e-9).sqrt() * often[group]


def prepare(
    folder: Path,
    splits: Sequence[str],
    augmentation: Augmentation | None,
    cache: Path,
    seed: int,
    commercial_only: bool = False,
) -> ClipSet:
    """Load, augment and convert a motion folder; kept under `cache` so that a resumed run starts at once."""
    key = json.dumps(
        [
            _FORMAT,
            str(folder.resolve()),
            [_content(folder / name) for name in COLLECTION],
            sorted(splits),
            augmentation and augmentation.model_dump(),
            seed,
            commercial_only,
        ]
    )
    sweep(cache)
    path = cache / f"windows-{hashlib.sha256(key.encode()).hexdigest()[:16]}.safetensors"
    if not path.is_file():
        clips = [c for c in load_motions(folder, splits) if c.commercial_ok or not commercial_only]
        if augmentation is not None:
            clips = augmented(clips, augmentation, seed)
        clips = [clip for clip in clips if clip.frames >= 5 and clip.captions]
        if not clips:
            raise UserError(f"motion folder '{folder}' has no captioned clip in split {' or '.join(splits)}; add some")
        _store(clips, path)
    return _load(path)


def _content(path: Path) -> str | None:
    """Digest of a file; None where there is none, which `load_motions` tells."""
    if not path.is_file():
        return None
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _store(clips: Sequence[Clip], path: Path) -> None:
    about: dict[str, Any] = {
        "told": [told(clip) for clip in clips],
        "groups": [kind_of(clip) for clip in clips],
        "sources": [clip.source for clip in clips],
        "ids": [clip.id for clip in clips],
        "licences": [clip.licence for clip in clips],
        "commercial": [clip.commercial_ok for clip in clips],
    }
    made = ClipSet.of([joints_to_features(clip.joints) for clip in clips], **about)
    arrays = {"features": made.features.float(), "starts": made.starts}
    with atomic_write(path) as file:
        file.write(save(arrays, metadata={"about": json.dumps(about)}))


def told(clip: Clip) -> list[Told]:
    """What happens when in a clip, as a `ClipSet` keeps it."""
    acts = clip.acts
    parts = [Told(act.begin, act.end, list(act.captions)) for act in acts]
    runs = [
        Told(acts[i].begin, acts[j - 1].end, list(in_one([act.captions for act in acts[i:j]], most=2)), j - i)
        for i in range(len(acts))
        for j in range(i + 2, len(acts) + 1)
        if j - i < len(acts)
    ]
    return [Told(0, clip.frames, list(clip.captions), max(1, len(acts))), *parts, *runs]


def _load(path: Path) -> ClipSet:
    try:
        with safe_open(path, framework="pt") as file:
            about = json.loads(file.metadata()["about"])
            about["told"] = [[Told(*each) for each in stretches] for stretches in about["told"]]
            # A copy: rows are read at random for hours, and a mapped file's pages may be evicted in the meantime.
            clips = ClipSet(file.get_tensor("features").clone(), file.get_tensor("starts").clone(), **about)
    except Exception as error:  # of many kinds; all mean the same to a user
        raise UserError(f"prepared data '{path}' is damaged; delete it and run again") from error
    if clips.features.shape[-1] != FEATURES:
        raise UserError(f"prepared data '{path}' does not fit this version; delete it and run again")
    return clips


def census(clips: ClipSet, names: Sequence[str]) -> dict[str, int]:
    """Frames by name, of which every clip has one (`clips.sources`, `clips.groups`)."""
    frames: Counter[str] = Counter()
    for name, length in zip(names, clips.lengths.tolist(), strict=True):
        frames[name] += int(length)
    return dict(frames)


def beginnings(data: ClipSet, frames: int, most: int = _MOST, seed: int = 0) -> Float[Tensor, "C T 263"]:
    """The first `frames` frames of every clip that is long enough, or of `most` of them drawn at random.

    Raises:
        UserError: no clip is long enough.
    """
    clips = (data.lengths >= frames).nonzero()[:, 0]
    if len(clips) > most:
        clips = clips[torch.randperm(len(clips), generator=torch.Generator().manual_seed(seed))[:most]]
    return _cut(data, data.starts[clips], frames)


def overlapping(data: ClipSet, frames: int) -> Float[Tensor, "W T 263"]:
    """All windows of `frames` frames that overlap by half.

    Raises:
        UserError: no clip is long enough.
    """
    starts = [
        first + offset
        for first, length in zip(data.starts[:-1].tolist(), data.lengths.tolist(), strict=True)
        for offset in range(0, length - frames + 1, frames // 2)
    ]
    return _cut(data, torch.tensor(starts, dtype=torch.long), frames)


def _cut(data: ClipSet, starts: Int[Tensor, " W"], frames: int) -> Float[Tensor, "W T 263"]:
    if not len(starts):
        raise UserError(f"no clip of the data has {frames} frames to measure a model on; add longer ones")
    rows = starts[:, None] + torch.arange(frames)
    return data.features[rows.to(data.features.device)]
