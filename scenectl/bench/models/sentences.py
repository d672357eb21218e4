"""Does a generator do one thing after another? Sentences of several acts, and sentences with their own times.

A frozen classifier looks at windows all along a motion. What it recognises there means something beside what it
recognises, by the same procedure, in recorded clips put one after another, and beside how often it finds the acts that
other sentences ask for.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.bench.models.asked import SENTENCES, Asked, Timeline, load_asked
from scenectl.bench.models.criteria import at_least, at_most
from scenectl.data.clips import ClipSet
from scenectl.data.features import FPS, features_to_joints, joints_to_features, on_body
from scenectl.data.sources import load_clips
from scenectl.evaluation.acts import composed_clips, held_out_pieces
from scenectl.evaluation.kinds import WINDOWS, KindClassifier
from scenectl.generators.base import Generator
from scenectl.measures.metrics import SEAM, seam_ratio
from scenes.motion.motion import Motion, Pose2D
from scenes.sdf.bake import default_cache

HOP = 0.2
"""Seconds between windows."""
GENERATED, RECORDED = "generated", "recorded"


@dataclass(frozen=True)
class Seen:
    """What the classifier takes a window (s) for."""

    begin: float
    end: float
    kind: str

    @property
    def middle(self) -> float:
        return round((self.begin + self.end) / 2, 6)  # equal ones shall be equal


def look(features: Float[Tensor, "T 263"], classifier: KindClassifier) -> list[Seen]:
    """All windows of a motion, by their middles; of a motion that is shorter than a window, the whole."""
    spans = set()
    for seconds in WINDOWS:
        frames = min(round(seconds * FPS), len(features))
        spans |= {(first, first + frames) for first in range(0, len(features) - frames + 1, round(HOP * FPS))}
    ordered = sorted(spans, key=lambda span: (sum(span), span))
    kinds = classifier.predict([features[begin:end] for begin, end in ordered])
    return [Seen(begin / FPS, end / FPS, kind) for (begin, end), kind in zip(ordered, kinds, strict=True)]


def in_order(seen: Sequence[Seen], wanted: Sequence[Sequence[str]]) -> bool:
    """Whether windows show one of the wanted kinds of each act, each act's window in the middle later than the last."""
    at = -math.inf
    for kinds in wanted:
        after = [window.middle for window in seen if window.kind in kinds and window.middle > at]
        if not after:
            return False
        at = min(after)
    return True


def in_time(seen: Sequence[Seen], kinds: Sequence[str], begin: float, end: float) -> bool:
    """Whether a window that lies from `begin` to `end` (s), or reaches no further beyond than a seam, shows the act."""
    return any(
        window.kind in kinds and begin - SEAM - 1e-6 <= window.begin and window.end <= end + SEAM + 1e-6
        for window in seen
    )


def bench_sentences(
    generator: Generator,
    classifier: KindClassifier,
    data: Path,
    file: str | Path | Asked | None = None,
    samples: int = 2,
    seed: int = 0,
    engine: Engine = ENGINE,
) -> Result:
    """Generate every sentence and timeline of a file, and look whether each act is there, in its order or time.

    Timelines are left out, and counted, where a generator takes one sentence only.

    Args:
        generator: the model.
        classifier: the second one.
        data: motion collection, whose held-out takes are put one after another to compare with.
        file: of sentences, or what it asks for; the one that ships by default.
        samples: motions of each, and recordings put together for each.
        seed: of motions and of what is drawn.
        engine: tells progress, keeps rows and goes on from them.

    Raises:
        UserError: the file is wrong, or the classifier does not know what it asks for.

    Returns:
        ``{"summary", "rows", "criteria"}``: a row for each motion, generated and recorded, with the acts of it that
        were recognised, the share of other sentences whose acts would have been, and a timeline's `seam_ratio`.
    """
    asked = file if isinstance(file, Asked) else load_asked(SENTENCES if file is None else file)
    asked.check(classifier.kinds)
    judge = _Judge(asked, classifier)
    takes = Takes.of(data, asked)
    able = "sentences" in generator.spec.abilities
    cases: list[tuple[str, tuple[str, int]]] = [
        (f"{origin}: {_name(asked, i)}", (origin, i))
        for origin in (RECORDED, GENERATED)
        for i in range(len(asked.sentence) + len(asked.timeline))
        if origin == RECORDED or able or i < len(asked.sentence)
    ]

    def measured(case: tuple[str, int]) -> list[Row]:
        origin, i = case
        if origin == RECORDED:
            return judge.recorded(takes, i, samples, torch.Generator().manual_seed(seed + i))
        return judge.generated(generator, i, samples, seed + i)

    settings = {"bench": "sentences", "data": data, "asked": asked.model_dump(), "samples": samples, "seed": seed}
    result = engine.run(cases, measured, _summary, settings)
    if "left" in result:
        return result
    result["summary"]["timelines_left_out"] = 0 if able else len(asked.timeline)
    result["summary"]["seam_ratio_composed"] = takes.seam_ratio
    return {**result, "criteria": _criteria(result["summary"])}


def _name(asked: Asked, i: int) -> str:
    count = len(asked.sentence)
    return asked.sentence[i].text if i < count else f"timeline {i - count + 1}"


@dataclass(frozen=True, eq=False)
class Takes:
    """Recordings that are put one after another, on a generated body's bones.

    Attributes:
        acts: features of clips that show one act, by its name.
        seam_ratio: median over composed test clips; None where there are none.
    """

    acts: dict[str, list[Float[Tensor, "_T 263"]]]
    seam_ratio: float | None

    @classmethod
    def of(cls, data: Path, asked: Asked) -> Takes:
        """Those of a collection's test split, whole and in pieces."""
        cache = default_cache() / "windows"
        sets = [load_clips(data, ["test"], None, cache, 0), held_out_pieces(data, cache)]
        by_kind: dict[str, list[Tensor]] = {}
        for clips in sets:
            for i, kind in enumerate(clips.groups):
                by_kind.setdefault(kind, []).append(on_body(_rows(clips, i)))
        acts = {act: [row for kind in kinds for row in by_kind.get(kind, ())] for act, kinds in asked.kinds.items()}
        shortest = round(WINDOWS[0] * FPS)
        return cls(
            {act: [row for row in rows if len(row) >= shortest] for act, rows in acts.items()},
            _composed_ratio(composed_clips(data, cache)),
        )

    def put_together(
        self, acts: Sequence[str], longest: Sequence[float], draw: torch.Generator
    ) -> list[Float[Tensor, "_T 263"]] | None:
        """A recording of each act, a stretch of `longest` seconds where it is longer; None where one has no recording.

        One behind the other, their rows are one motion: they hold velocities and poses as seen from the body.
        """
        if not all(self.acts[act] for act in acts):
            return None
        rows = []
        for act, seconds in zip(acts, longest, strict=True):
            found = self.acts[act][int(torch.randint(len(self.acts[act]), (), generator=draw))]
            frames = min(len(found), round(seconds * FPS))
            first = int(torch.randint(len(found) - frames + 1, (), generator=draw))
            rows.append(found[first : first + frames])
        return rows


def _rows(clips: ClipSet, i: int) -> Float[Tensor, "_T 263"]:
    return clips.features[int(clips.starts[i]) : int(clips.starts[i + 1])]


def _composed_ratio(clips: ClipSet | None) -> float | None:
    """Median of the seam ratios of clips of several acts."""
    found = []
    for i in range(0 if clips is None else len(clips.ids)):
        assert clips is not None
        begins = [part.begin / FPS for part in clips.told[i] if part.acts == 1 and part.begin > 0]
        found.append(seam_ratio(Motion(features_to_joints(_rows(clips, i))), begins))
    return _median(found)


@dataclass(frozen=True, eq=False)
class _Judge:
    """Looks for the acts of one sentence or timeline after another."""

    asked: Asked
    classifier: KindClassifier

    def generated(self, generator: Generator, i: int, samples: int, seed: int) -> list[Row]:
        count = len(self.asked.sentence)
        if i < count:
            told = self.asked.sentence[i]
            made = generator.generate(told.text, told.seconds, Pose2D(), samples=samples, seed=seed).motion
            return [self._sentence(GENERATED, i, joints_to_features(joints)) for joints in made.joints]
        line = self.asked.timeline[i - count]
        made = generator.generate(line.prompts, line.seconds, Pose2D(), samples=samples, seed=seed).motion
        return [
            self._timeline(
                GENERATED, line, joints_to_features(motion.joints),
                [(part.begin, part.end) for part in line.part], seam_ratio(motion, line.seams),
            )
            for motion in (made[s] for s in range(samples))
        ]  # fmt: skip

    def recorded(self, takes: Takes, i: int, samples: int, draw: torch.Generator) -> list[Row]:
        """Rows of recordings put one after another; none where an act has no recording."""
        count, acts = len(self.asked.sentence), self.asked.acts[i]
        if i < count:
            longest = [self.asked.sentence[i].seconds / len(acts)] * len(acts)
        else:
            longest = [part.end - part.begin for part in self.asked.timeline[i - count].part]
        rows = []
        for _ in range(samples):
            parts = takes.put_together(acts, longest, draw)
            if parts is None:
                return []
            if i < count:
                rows.append(self._sentence(RECORDED, i, torch.cat(parts)))
            else:
                ends = torch.tensor([0, *map(len, parts)]).cumsum(0) / FPS
                times = list(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True))
                rows.append(self._timeline(RECORDED, self.asked.timeline[i - count], torch.cat(parts), times, None))
        return rows

    def _sentence(self, origin: str, i: int, features: Float[Tensor, "T 263"]) -> Row:
        seen, told, kinds = look(features, self.classifier), self.asked.sentence[i], self.asked.kinds
        others = {each.acts for each in self.asked.sentence if len(each.acts) == len(told.acts)} - {told.acts}
        chance = [in_order(seen, [kinds[act] for act in acts]) for acts in sorted(others)]
        recognised = in_order(seen, [kinds[act] for act in told.acts])
        return _row(origin, told.text, told.acts, [recognised], chance, seen)

    def _timeline(
        self,
        origin: str,
        line: Timeline,
        features: Float[Tensor, "T 263"],
        times: Sequence[tuple[float, float]],
        ratio: float | None,
    ) -> Row:
        seen, kinds = look(features, self.classifier), self.asked.kinds
        acts = tuple(part.act for part in line.part)
        found = [in_time(seen, kinds[act], *time) for act, time in zip(acts, times, strict=True)]
        others = {part.act for each in self.asked.timeline for part in each.part}
        chance = [
            in_time(seen, kinds[other], *time)
            for act, time in zip(acts, times, strict=True)
            for other in sorted(others - {act})
        ]
        text = " | ".join(part.text for part in line.part)
        return {**_row(origin, text, acts, found, chance, seen), "seam_ratio": _number(ratio)}


def _row(
    origin: str,
    text: str,
    acts: Sequence[str],
    found: Sequence[bool],
    chance: Sequence[bool],
    seen: Sequence[Seen],
) -> Row:
    middle = [window for window in seen if abs(window.end - window.begin - WINDOWS[1]) < 1e-6] or seen
    runs = [(kind, list(windows)) for kind, windows in groupby(middle, key=lambda window: window.kind)]
    return {
        "set": origin,
        "text": text,
        "acts": list(acts),
        "recognised": sum(found) / len(found),
        "by_chance": statistics.fmean(chance) if chance else None,
        "found": list(found),
        "seam_ratio": None,
        "timeline": len(found) > 1,
        "seen": [[kind, windows[0].middle, windows[-1].middle] for kind, windows in runs],
    }


def _number(value: float | None) -> float | None:
    return None if value is None or math.isnan(value) else value


def _median(values: Sequence[float]) -> float | None:
    known = [value for value in values if not math.isnan(value)]
    return statistics.median(known) if known else None


def _summary(rows: Sequence[Row]) -> dict[str, Any]:
    sentences, lines = ([row for row in rows if row["timeline"] is kind] for kind in (False, True))
    counts = sorted({len(row["acts"]) for row in sentences})
    return {
        "sentences": _by_set(sentences, _mean),
        **{
            f"sentences_of_{n}": _by_set([row for row in sentences if len(row["acts"]) == n], _mean) for n in counts
        },
        "sentences_by_chance": _by_set(sentences, _chance),
        "timeline_parts": _by_set(lines, _mean),
        "timeline_parts_by_chance": _by_set(lines, _chance),
        "whole_timelines": _by_set(lines, lambda some: statistics.fmean(row["recognised"] == 1 for row in some)),
        "seam_ratio": _median([row["seam_ratio"] for row in lines if row["seam_ratio"] is not None]),
        "motions": _by_set(rows, len),
    }  # fmt: skip


def _by_set(rows: Sequence[Row], figure: Any) -> dict[str, Any]:
    """A figure of the rows of each set; None where it has none."""
    sets = {name: [row for row in rows if row["set"] == name] for name in (GENERATED, RECORDED)}
    return {name: figure(some) if some else None for name, some in sets.items()}


def _mean(rows: Sequence[Row]) -> float:
    return statistics.fmean(row["recognised"] for row in rows)


def _chance(rows: Sequence[Row]) -> float | None:
    known = [row["by_chance"] for row in rows if row["by_chance"] is not None]
    return statistics.fmean(known) if known else None


def _criteria(summary: Mapping[str, Any]) -> list[Row]:
    """What issue 24 wants of sentences and timelines."""
    return [
        at_least("two- and three-action sentences recognised in order", 0.8, summary["sentences"][GENERATED]),
        at_least("sentences of timelines recognised in their own time", 0.85, summary["timeline_parts"][GENERATED]),
        at_most("seam ratio of timelines, median", 1.2, summary["seam_ratio"]),
    ]
