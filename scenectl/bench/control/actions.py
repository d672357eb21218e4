"""Random scripts of actions: is each action done, in its time, as a person would do it?"""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from torch import Tensor

from scenectl.bench.control.scripts import SENTENCES, WAVES, Drawn, Room, Scripts, asked
from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.bench.models.criteria import at_least
from scenectl.bench.models.sentences import Seen, in_time, look
from scenectl.data.features import joints_to_features
from scenectl.evaluation.kinds import KindClassifier
from scenectl.generators.base import Generator
from scenectl.measures.believability.judge import Judge
from scenectl.measures.believability.verdict import Verdict
from scenectl.measures.metrics import SEAM, Depths, seam_ratio
from scenectl.pipeline.results import Result as Made
from scenectl.pipeline.run import run
from scenectl.tasks.actions.registry import actions
from scenectl.tasks.actions.script import Stretch
from scenes.errors import UserError
from scenes.motion.bones import standing_pose
from scenes.motion.headings import heading, turned
from scenes.motion.motion import Motion
from scenes.world.scene import bundled_names

WANTED = ("walk", "turn", "stand", "sit", "stand_up", "reach", "duck", "wave", "pick_up", "put_down")
"""Kinds of which a share of `ACTIONS` shall succeed; others are reported."""
ACTIONS, SCRIPTS = 0.8, 0.6
"""Shares of actions of each kind, and of scripts, that shall succeed; what is asked of scripts."""

Pictures = Callable[[Made, Path], None]
"""Draws a result into a file."""


def bench_actions(
    generator: Generator,
    classifier: KindClassifier,
    scenes: Sequence[str | Path] = (),
    scripts: int = 150,
    seed: int = 0,
    samples: int = 4,
    pictures: tuple[Path, Pictures] | None = None,
    engine: Engine = ENGINE,
) -> Result:
    """Run random scripts in scenes by turns, and look what became of each action of the sample that is ranked first.

    An action succeeds that is done, believable and in order:

    - done: all its goals are met, each in its window of the action's time; `wave` and `act`, of which goals say little,
      are also to be found by the classifier somewhere in the motion (`on_standing_legs` where somebody sits).
    - believable: the judge finds no fault with the action's time and `SEAM` to both sides of it.
    - in order: what the classifier finds lies within the action's own time, but for a seam. Goals have no other time
      than that, so that of the other kinds whatever is done is in order.

    A script succeeds when all its actions do; one of which nothing could be made fails with all of them. `by_chance` is
    how often the classifier would have found, in the time of a `wave` or an `act`, what another of them asks for.

    Args:
        generator: what makes the motions.
        classifier: the second one.
        scenes: names of bundled scenes, or files; all bundled ones where none is given.
        scripts: how many, in all scenes together.
        seed: of scripts and motions.
        samples: motions made for each script.
        pictures: folder, and what draws the first sample of each script that fails into a file there.
        engine: tells progress, keeps rows and goes on from them.

    Raises:
        UserError: an unreadable scene, one in which nothing can be done, or a seed or samples that no run takes.

    Returns:
        ``{"summary", "rows", "criteria"}``: a row for each action, ratios and seconds.
    """
    if not 0 <= seed < 2**63 - scripts or not 1 <= samples <= 256:
        raise UserError(
            f"seed {seed} and {samples} samples; give a seed from 0 to 2**63 less the scripts, and 1 to 256"
        )
    names = [str(scene) for scene in scenes or bundled_names()]
    rooms = {name: Room.of(name, generator.spec, classifier.kinds) for name in names}
    drawer = Scripts(np.random.default_rng(seed), generator.spec)

    def cases() -> Iterator[tuple[str, tuple[int, Drawn]]]:
        for i in range(scripts):
            name = names[i % len(names)]
            drawn = drawer.draw(rooms[name], seed + i)
            yield f"{rooms[name].scene.name}: {', '.join(drawn.kinds)}", (i, drawn)

    def measured(case: tuple[int, Drawn]) -> list[Row]:
        i, drawn = case
        about = {"script": i, "scene": drawn.room.scene.name}
        try:
            made = run(drawn.task, samples, seed + i, generator, setup=drawn.setup, scorer=drawn.room.scorer)
        except UserError as error:  # the planner took it: that nothing is made of it is a failure, and no rejection
            return [{**about, **row} for row in _refused(drawn, str(error))]
        rows = _Looked.at(made, drawn, classifier).rows()
        if pictures is not None and not all(row["success"] for row in rows):
            folder, draw = pictures
            folder.mkdir(parents=True, exist_ok=True)
            draw(made, folder / f"script_{i:03d}.png")
        return [{**about, **row} for row in rows]

    def summary(rows: Sequence[Row]) -> dict[str, Any]:
        out = {kind: "no such action" for kind in WANTED if kind not in {spec.name for spec in actions()}}
        rejected = dict(drawer.rejected.most_common())
        return {**_summary(rows), "rejected": rejected, "not_drawn": out | drawer.left_out()}

    settings = {"bench": "actions", "scenes": names, "scripts": scripts, "seed": seed, "samples": samples}
    result = engine.run(cases(), measured, summary, settings, scripts)
    return result if "left" in result else {**result, "criteria": _criteria(result["summary"])}


@dataclass(frozen=True, eq=False)
class _Looked:
    """The first-ranked sample of a script, and what looks at its actions.

    Attributes:
        made, drawn: result and script.
        motion: of the sample, ``[T, J, 3]`` m, in the scene's frame.
        judge, depths: of that motion.
        classifier: the second one.
    """

    made: Made
    drawn: Drawn
    motion: Motion
    judge: Judge
    depths: Depths
    classifier: KindClassifier

    @classmethod
    def at(cls, made: Made, drawn: Drawn, classifier: KindClassifier) -> _Looked:
        setup, scorer = drawn.setup, drawn.room.scorer.within(drawn.setup.scene)
        motion, judge = made.motion[0].seen_from(setup.origin), Judge.of(scorer, setup.prompts, setup.objective)
        return cls(made, drawn, motion, judge, scorer.depths(motion), classifier)

    def rows(self) -> list[Row]:
        """A row for each action."""
        script, best = self.drawn.setup.script, self.made.samples[0]
        assert script is not None
        ratio = seam_ratio(self.motion, [one.begin for one in script.stretches[1:]])
        whole = {
            "sample_good": best.good,
            "seam_ratio": None if math.isnan(ratio) else ratio,
            "seconds": self.made.report["timing"]["generate_s"],
        }
        return [
            {**self._row(one, table), **whole} for one, table in zip(script.stretches, self.drawn.tables, strict=True)
        ]

    def _row(self, one: Stretch, table: Mapping[str, Any]) -> Row:
        begins = f"{one.entry.number} {one.entry.name}: "
        missed = [
            term.name.removeprefix(begins)
            for term in self.made.samples[0].terms
            if term.name.startswith(begins) and not term.met
        ]
        verdict, kinds = self._verdict(one), asked(table)
        seen = [] if kinds is None else self._seen(one)
        found = kinds is None or any(window.kind in kinds for window in seen)
        timely = kinds is None or in_time(seen, kinds, one.begin, one.end)
        row = {
            **_about(one, table),
            "done": not missed and found, "believable": verdict.believable, "in_order": not missed and timely,
            "missed": missed + ([] if found else ["not recognised"]), "verdict": verdict.sentence,
            "checks": [finding.check for finding in verdict.findings],
            "by_chance": _by_chance(seen, kinds, one),
            "seen": dict(Counter(w.kind for w in seen if w.end > one.begin and w.begin < one.end).most_common(3)),
        }  # fmt: skip
        return {**row, "success": bool(row["done"] and row["believable"] and row["in_order"])}

    def _verdict(self, one: Stretch) -> Verdict:
        """On an action's time with a seam on both sides."""
        motion = self.motion
        begin, end = (round(time * motion.fps) for time in (max(one.begin - SEAM, 0.0), one.end + SEAM))
        some = slice(begin, min(end, motion.frames))
        cut = replace(motion, joints=motion.joints[some], valid=motion.valid[some], t0=begin / motion.fps)
        return self.judge.verdict(cut, Depths(**{name: values[some] for name, values in vars(self.depths).items()}))

    def _seen(self, one: Stretch) -> list[Seen]:
        """What the classifier sees all along the motion, over the ground on which the action begins.

        It has learnt no gesture of people who sit, and takes each for sitting: it sees these on standing legs.
        """
        if one.before.posture == "sitting":
            return look(joints_to_features(on_standing_legs(self.motion)), self.classifier)
        ground = one.before.place[1] + self.drawn.setup.body.sole_offset
        joints = self.motion.joints - self.motion.joints.new_tensor([0.0, ground, 0.0])
        return look(joints_to_features(joints), self.classifier)


def on_standing_legs(motion: Motion) -> Float[Tensor, "T J 3"]:
    """Joints (m) of one motion ``[T, J, 3]`` with straight legs under the same trunk, standing on the ground at 0."""
    pose, names = standing_pose(motion.skeleton).to(motion.joints), motion.skeleton.names
    legs = [i for i, name in enumerate(names) if name.endswith(("_hip", "_knee", "_ankle", "_foot"))]
    joints = motion.joints.clone()
    joints[..., 1] += pose[0, 1] - pose[:, 1].min() - joints[:, :1, 1]
    joints[:, legs] = joints[:, :1] + turned(pose[legs] - pose[0], heading(motion, ("hip",))[:, None])
    return joints


def _about(one: Stretch, table: Mapping[str, Any]) -> Row:
    """Which action it is."""
    told = {"number": one.entry.number, "kind": one.entry.spec.name, "asked": dict(table)}
    return {**told, "begin": one.begin, "end": one.end}


def _refused(drawn: Drawn, why: str) -> list[Row]:
    """A row for each action of a script of which nothing could be made."""
    assert drawn.setup.script is not None
    failed = dict.fromkeys(("done", "believable", "in_order", "success", "sample_good"), False)
    nothing = dict.fromkeys(("by_chance", "seam_ratio", "seconds"))
    rest: Row = {"missed": ["nothing made"], "verdict": why, "checks": [], "seen": {}, **failed, **nothing}
    return [{**_about(*each), **rest} for each in zip(drawn.setup.script.stretches, drawn.tables, strict=True)]


def _by_chance(seen: Sequence[Seen], kinds: Sequence[str] | None, one: Stretch) -> float | None:
    """Share of what others of `WAVES` and `SENTENCES` ask for that would have been found in an action's time."""
    others = [some for some in (*WAVES.values(), *SENTENCES.values()) if not set(some) & set(kinds or ())]
    return None if kinds is None else statistics.fmean(in_time(seen, some, one.begin, one.end) for some in others)


def _summary(rows: Sequence[Row]) -> dict[str, Any]:
    kinds = {kind: [row for row in rows if row["kind"] == kind] for kind in sorted({row["kind"] for row in rows})}
    scripts = [[row for row in rows if row["script"] == i] for i in dict.fromkeys(row["script"] for row in rows)]

    def by_kind(key: str) -> dict[str, float]:
        return {kind: statistics.fmean(row[key] for row in some) for kind, some in kinds.items()}

    return {
        "scripts": len(scripts),
        "actions": {kind: len(some) for kind, some in kinds.items()},
        "script_success_rate": statistics.fmean(all(row["success"] for row in some) for some in scripts),
        "action_success_rate": by_kind("success"),
        "done_rate": by_kind("done"),
        "believable_rate": by_kind("believable"),
        "in_order_rate": by_kind("in_order"),
        "recognised_by_chance": _mean([row["by_chance"] for row in rows]),
        "faults": {
            kind: dict(Counter(fault for row in some for fault in (*row["missed"], *row["checks"])).most_common())
            for kind, some in kinds.items()
        },
        "samples_met_and_believable_rate": statistics.fmean(some[0]["sample_good"] for some in scripts),
        "seam_ratio": _median([some[0]["seam_ratio"] for some in scripts]),
        "median_seconds": _median([some[0]["seconds"] for some in scripts]),
    }


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return statistics.fmean(known) if known else None


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return statistics.median(known) if known else None


def _criteria(summary: Mapping[str, Any]) -> list[Row]:
    """What is wanted of each kind and of scripts."""
    rates = summary["action_success_rate"]
    return [
        *(at_least(f"'{kind}' done, believable and in order", ACTIONS, rates.get(kind)) for kind in WANTED),
        at_least("scripts of which every action is", SCRIPTS, summary["script_success_rate"]),
    ]
