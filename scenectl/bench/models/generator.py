"""All that is measured about a generator, in one run, beside real motions, reconstructions and random tokens."""

from __future__ import annotations

import re
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.bench.models.criteria import at_least, at_most, within
from scenectl.bench.models.posterior import bench_posterior
from scenectl.bench.models.tokenizer import bench_tokenizer
from scenectl.bench.studies.recordings import LEFT_OUT
from scenectl.data.clips import overlapping
from scenectl.data.features import FPS
from scenectl.data.sources import is_humanml3d, load_clips
from scenectl.evaluation.acts import held_out_pieces, is_edit
from scenectl.evaluation.evaluator import Evaluator
from scenectl.evaluation.kinds import ALONE, Confusion, KindClassifier
from scenectl.evaluation.metrics import (
    Estimate,
    check_enough,
    diversity,
    frechet_distance,
    multimodal_distance,
    multimodality,
    r_precision,
    repeated,
)
from scenectl.evaluation.sets import HeldOut, MotionSet, Tokenised, generated, of_random_tokens, real, reconstructed
from scenectl.generators.base import Generator, Progress
from scenectl.generators.mscot.sampling import MSCoT
from scenectl.generators.mscot.training.measures import code_use, least_use
from scenectl.measures.believability.judge import Judge
from scenectl.measures.metrics import Scorer
from scenectl.measures.plausibility import plausibility
from scenectl.training.errors import QUICK, power_above
from scenes.body.body import DEFAULT_BODY
from scenes.files import atomic_write
from scenes.motion.motion import Motion, Pose2D
from scenes.sdf.bake import default_cache
from scenes.world.scene import Scene

MULTIMODAL = (20, 10)
"""Prompts and motions of each behind multimodality."""
REAL, RECONSTRUCTION, RANDOM = "real", "reconstruction", "random tokens"
GENERATED, BEFORE = "generated", "other weights"
"""Names of sets."""
SEEDS_APART = 100_003
"""Between the seeds of two motions of the same clip: every clip has a seed of its own."""
PIECES = 40
"""Pieces of held-out recordings of each kind that the second classifier looks at, at most."""
OVER_REAL = {
    "skating": "skating_ratio",
    "acceleration": "acceleration_m_per_s2",
    "max_acceleration": "max_acceleration_m_per_frame2",
    "power": "quick_power_m2",
}
"""Figures of rows that are compared with those of real motions, by a short name."""
FAITHFUL = {
    "reconstruction_error_m": ("Bandai", 0.04),
    "reconstruction_error_other_m": ("other sources", 0.08),
}
"""Figures of the tokenizer, of which clips, and metres at most."""
NEW_ACTS = ("idle", "stop", "sit down", "sit", "stand up", "climb", "pick up", "put down", "carry")
"""Kinds that issue 24 asks of a generator."""
_SCENE = re.compile(
    r"\b(sit|sits|sitting|seat|seated|chair|stool|sofa|couch|bench|stairs?|staircase|steps? (up|down)|climb\w*|ladder|"
    r"hang\w*|swing\w*|slope|uneven|uphill|downhill|lie|lies|lying|bed|crawl\w*|table|shelf|"
    r"jumps? (on|off|over|from)\w*)\b"
)
"""Words of captions that ask for something to be there."""
_FLOOR = Scorer(Scene.empty())


def bench_generator(
    generator: Generator,
    evaluator: Evaluator | None,
    classifier: KindClassifier,
    data: Path,
    clips: int | None = None,
    repeats: int = 20,
    seed: int = 0,
    engine: Engine = ENGINE,
    seeds: int = 1,
    acts: KindClassifier | None = None,
    against: Generator | None = None,
) -> Result:
    """Evaluate a model on the test split.

    For each test clip a motion is generated with each seed, from its caption and of its length. R-precision and
    diversity are repeated over what is drawn; FID is repeated over bootstrap samples of both sets beside its value on
    the whole sets.

    Args:
        generator: the model.
        evaluator: behind FID, R-precision, distances; its name stands in the result. Without one only real and
            generated motions are looked at: their kinds, plausibility, and whether they are believable.
        classifier: of kinds of motion, frozen.
        data: folder of the motion collection, or of HumanML3D.
        clips: at most so many test clips, by default all.
        repeats: of everything random.
        seed: of generated motions and draws.
        engine: tells progress, keeps rows and goes on from them.
        seeds: motions generated for each clip; figures of generated motions are means over them.
        acts: the second classifier of kinds, which also looks at pieces of held-out recordings.
        against: other weights, which generate once.

    Returns:
        ``{"summary", "rows", "evaluator", "clips", "kinds", "recall", "criteria"}``, a row for each set and seed,
        "recall_of_acts" of the second classifier, and of MSCoT's tokens "code_use", "reconstruction" and "posterior".
    """
    test = HeldOut.of(load_clips(data, ["test"], None, _cache(), 0), generator.spec, seed, clips)
    # Too few clips, or captions that the evaluator cannot read, are found before minutes go into motions.
    if evaluator is not None:
        check_enough(len(test.captions))
    evaluation = _Evaluation(generator, evaluator, classifier, test, repeats, seed, engine.progress, acts, against)
    of_tokens = (RECONSTRUCTION, RANDOM) if evaluator and isinstance(generator, Tokenised) else ()
    sets = [(REAL, 0), *((name, 0) for name in of_tokens), *((GENERATED, k) for k in range(seeds))]
    settings = {
        "bench": "generator", "evaluator": evaluator and evaluator.name, "data": data, "clips": clips,
        "repeats": repeats, "seed": seed, "acts": acts is not None, "against": against is not None,
    }  # fmt: skip
    result = engine.run(
        [(f"motions: {name}, seed {k}", (name, k)) for name, k in [*sets, *([(BEFORE, 0)] if against else [])]],
        evaluation.rows,
        lambda rows: {},
        settings,
    )
    seen, acts_seen = _seen(result["rows"], "kinds"), _seen(result["rows"], "acts")
    result["kinds"] = {name: _kinds(confusion) for name, confusion in seen.items()}
    result["recall"] = recall_table(seen[REAL], seen[GENERATED])
    if acts is not None:
        result["recall_of_acts"] = _recall_of_acts(evaluation, data, seeds, engine, settings, acts_seen)
    tokens = _tokens(generator, data, seed, engine.whole) if evaluator and isinstance(generator, MSCoT) else {}
    result["summary"] = _summary(result) | tokens.pop("summary", {})
    result["criteria"] = _criteria(result)
    return {**result, "evaluator": evaluator and evaluator.name, "clips": len(test.captions), **tokens}


def asks_for_scene(kind: str, caption: str) -> bool:
    """Whether a motion of that kind or caption needs more than a floor."""
    return kind in LEFT_OUT or _SCENE.search(caption.lower()) is not None


@dataclass(frozen=True, eq=False)
class _Evaluation:
    """What the sets of motions have in common."""

    generator: Generator
    evaluator: Evaluator | None
    classifier: KindClassifier
    test: HeldOut
    repeats: int
    seed: int
    progress: Progress
    acts: KindClassifier | None = None
    against: Generator | None = None

    @cached_property
    def points(self) -> tuple[Float[Tensor, "N d"], Float[Tensor, "N d"]]:
        """Of the real motions and of their captions."""
        assert self.evaluator is not None
        return self.evaluator.embed_motions(real(self.test).features), self.evaluator.embed_texts(self.test.captions)

    def motions(self, name: str, k: int, clips: HeldOut) -> MotionSet:
        """The set of that name, made with the k-th seed."""
        if name == REAL:
            return real(clips)
        if name in (GENERATED, BEFORE):
            maker = self.generator if self.against is None or name == GENERATED else self.against
            made = generated(clips, maker, self.seed + k * SEEDS_APART, self.progress)
            return replace(made, name=name)
        assert isinstance(self.generator, Tokenised)
        if name == RECONSTRUCTION:
            return reconstructed(clips, self.generator.round_trip)
        return of_random_tokens(clips, self.generator, self.seed)

    def rows(self, case: tuple[str, int]) -> list[Row]:
        """Everything about one set."""
        name, k = case
        motions = self.motions(name, k, self.test)
        row: Row = {"set": name}
        if self.evaluator is not None:
            row |= _standard(self.evaluator.embed_motions(motions.features), *self.points, self.repeats, self.seed)
            if case == (GENERATED, 0):
                row["multimodality"] = _multimodality(self.generator, self.evaluator, self.test, self.seed)
        confusion = Confusion.of(self.test.kinds, self.classifier.predict(motions.features))
        acts = Confusion.of(self.test.kinds, self.acts.predict(motions.features)) if self.acts else None
        return [
            {
                **row,
                **_plausible(motions),
                "believable": _believable(motions, self.test),
                "label_recall": confusion.macro_recall,
                "kinds": _kinds(confusion),
                "acts": acts and _kinds(acts),
            }
        ]


def _believable(motions: MotionSet, test: HeldOut) -> float | None:
    """Share of the motions that the verdict believes, of captions that ask for no scene; None where there are none."""
    judged = [
        Judge(_FLOOR, caption).verdict(Motion(joints + joints.new_tensor([0.0, DEFAULT_BODY.sole_offset, 0.0])))
        for joints, caption, kind in zip(motions.joints, test.captions, test.kinds, strict=True)
        if not asks_for_scene(kind, caption)
    ]
    return sum(verdict.believable for verdict in judged) / len(judged) if judged else None


def _seen(rows: Sequence[Row], key: str) -> dict[str, Confusion]:
    """What was taken for what in each set, all seeds together; taken out of the rows."""
    parts: dict[str, list[Confusion]] = {}
    for row in rows:
        if (found := row.pop(key)) is not None:
            confusion = Confusion(tuple(found["kinds"]), torch.tensor(found["confusion"], dtype=torch.long))
            parts.setdefault(row["set"], []).append(confusion)
    return {name: Confusion.joined(some) for name, some in parts.items()}


def _recall_of_acts(
    evaluation: _Evaluation,
    data: Path,
    seeds: int,
    engine: Engine,
    settings: Mapping[str, Any],
    seen: Mapping[str, Confusion],
) -> list[Row]:
    """Recall of the second classifier: on the test clips, and on pieces of held-out recordings where there are any."""
    classifier, parts = evaluation.acts, [seen]
    assert classifier is not None
    pieces = None if is_humanml3d(data) else held_out_pieces(data, _cache())
    edited = (
        {group for group, name in zip(pieces.groups, pieces.ids, strict=True) if is_edit(name)} if pieces else set()
    )
    if pieces and (pieces.lengths >= evaluation.generator.spec.shortest_frames).any():
        clips = HeldOut.of(pieces, evaluation.generator.spec, evaluation.seed).at_most(PIECES)

        def measured(case: tuple[str, int]) -> list[Row]:
            predicted = classifier.predict(evaluation.motions(*case, clips).features)
            return [{"set": case[0], "acts": _kinds(Confusion.of(clips.kinds, predicted))}]

        cases = [(REAL, 0), *((GENERATED, k) for k in range(seeds))]
        named = [(f"pieces: {name}, seed {k}", (name, k)) for name, k in cases]
        parts.append(_seen(engine.run(named, measured, lambda rows: {}, {**settings, "pieces": True})["rows"], "acts"))
    both = {name: Confusion.joined([part[name] for part in parts]) for name in (REAL, GENERATED)}
    rows = recall_table(both[REAL], both[GENERATED], NEW_ACTS)
    return [{**row, "of": "edits of test clips" if row["kind"] in edited else "recordings"} for row in rows]


def _cache() -> Path:
    return default_cache() / "windows"


def _tokens(generator: MSCoT, data: Path, seed: int, engine: Engine) -> dict[str, Any]:
    """What only a generator of tokens has: reconstruction, codes in use, and how good the guided posterior is."""
    reconstruction = bench_tokenizer(generator, data, engine=engine)
    train = load_clips(data, ["train"], None, _cache(), 0)
    use = code_use(generator.bundle.tokenizer, overlapping(train, 64))
    posterior = bench_posterior(generator, seed=seed, engine=engine)
    keys = (
        "reconstruction_error_m", "reconstruction_error_other_m", "root_drift_m", "root_drift_other_m",
    )  # fmt: skip
    return {
        "summary": {
            **{key: reconstruction["summary"][key] for key in keys},
            "code_use": least_use(use),
            "posterior_kl": posterior["summary"]["kl_nats"],
        },
        "code_use": use,
        "reconstruction": reconstruction["rows"],
        "posterior": posterior["rows"],
    }


def _standard(points: Float[Tensor, "N d"], truth: Float[Tensor, "N d"], texts: Tensor, repeats: int, seed: int) -> Row:
    """What an evaluator says of one set; intervals are half-widths at 95 %."""
    ranks = [r_precision(texts, points, torch.Generator().manual_seed(seed + i)) for i in range(repeats)]
    top3 = repeated(lambda draw: float(ranks[draw.initial_seed() - seed][2]), repeats, seed)
    varied = repeated(lambda draw: diversity(points, draw), repeats, seed)
    spread = repeated(lambda draw: _bootstrapped(points, truth, draw), repeats, seed)
    return {
        "fid": frechet_distance(points, truth),
        **_estimate("fid_bootstrap", spread),
        "r_precision_top1": float(torch.stack(ranks)[:, 0].mean()),
        "r_precision_top2": float(torch.stack(ranks)[:, 1].mean()),
        **_estimate("r_precision_top3", top3),
        "multimodal_distance": multimodal_distance(texts, points),
        **_estimate("diversity", varied),
        "multimodality": None,
    }


def _plausible(motions: MotionSet) -> Row:
    """Figures of one set that need no evaluator."""
    return {
        **{name: float(value.mean()) for name, value in plausibility(motions.padded).items()},
        "quick_power_m2": statistics.fmean(power_above(joints[None], QUICK) for joints in motions.joints),
        "limb_ends_moved_m": sum(motions.moved) / len(motions.moved) if motions.moved else None,
    }


def _estimate(name: str, figure: Estimate) -> dict[str, float]:
    return {name: figure.mean, f"{name}_interval": figure.interval}


def _bootstrapped(points: Tensor, truth: Tensor, draw: torch.Generator) -> float:
    a, b = (x[torch.randint(len(x), (len(x),), generator=draw)] for x in (points, truth))
    return frechet_distance(a, b)


def _multimodality(generator: Generator, evaluator: Evaluator, test: HeldOut, seed: int) -> float:
    """Spread of motions of the same prompt, over prompts that differ."""
    draw = torch.Generator().manual_seed(seed)
    prompts, samples = MULTIMODAL
    order = torch.randperm(len(test.captions), generator=draw).tolist()
    chosen = list({test.captions[i]: i for i in order}.values())[:prompts]
    points = []
    for i in chosen:
        made = generator.generate(
            test.captions[i], len(test.features[i]) / FPS, Pose2D(), samples=samples, seed=seed + i
        )
        points.append(evaluator.embed_motions(MotionSet.of("", list(made.motion.joints)).features))
    return multimodality(torch.stack(points), draw)


def _kinds(found: Confusion) -> dict[str, Any]:
    recall = found.recall()
    return {
        "macro_recall": found.macro_recall,
        "recall": recall,
        "worst": min(recall, key=lambda kind: recall[kind]) if recall else None,
        "kinds": list(found.kinds),
        "confusion": found.counts.tolist(),
    }


def recall_table(truth: Confusion, made: Confusion, always: Sequence[str] = ()) -> list[Row]:
    """Recall of each kind on real and on generated motions, and their ratio; None where it is not known.

    Kinds with fewer clips than `ALONE` share a row, but for those of `always`.
    """
    alone = [kind for kind, clips in truth.clips.items() if clips >= ALONE or kind in always]
    rarer = [kind for kind in truth.clips if kind not in alone]
    groups = {**{kind: [kind] for kind in alone}, **({f"rarer ({len(rarer)} kinds)": rarer} if rarer else {})}
    rows = []
    for name, kinds in groups.items():
        right, got = truth.recall_of(kinds), made.recall_of(kinds)
        clips = sum(truth.clips[kind] for kind in kinds)
        ratio = got / right if right and got is not None else None
        rows.append({"kind": name, "clips": clips, "real": right, "generated": got, "ratio": ratio})
    return rows


def _mean(rows: Sequence[Row]) -> Row:
    """Means of the figures of several rows."""
    known = (key for key in rows[0] if all(isinstance(row[key], float | int) for row in rows))
    return {key: statistics.fmean(row[key] for row in rows) for key in known}


def _summary(result: Mapping[str, Any]) -> dict[str, Any]:
    rows, kinds = result["rows"], result["kinds"]
    by_name = {row["set"]: row for row in rows}
    truth, made = by_name[REAL], _mean([row for row in rows if row["set"] == GENERATED])
    known = [row for row in result["recall"] if row["ratio"] is not None]
    worst: Row = min(known, key=lambda row: row["ratio"], default={})
    return {
        **{key: made[key] for key in ("skating_ratio", "max_acceleration_m_per_frame2", "acceleration_m_per_s2")},
        "skating_ratio_real": truth["skating_ratio"],
        "max_acceleration_real_m_per_frame2": truth["max_acceleration_m_per_frame2"],
        "acceleration_real_m_per_s2": truth["acceleration_m_per_s2"],
        **{f"{name}_over_real": made[key] / truth[key] if truth[key] else None for name, key in OVER_REAL.items()},
        "bone_length_drift_m": made["bone_length_drift_m"],
        "limb_ends_moved_m": made.get("limb_ends_moved_m"),
        "fid": made.get("fid"),
        **{
            f"fid_{name.replace(' ', '_')}": row.get("fid")
            for name, row in by_name.items()
            if name not in (REAL, GENERATED)
        },
        "r_precision_top3": made.get("r_precision_top3"),
        "r_precision_top3_real": truth.get("r_precision_top3"),
        "believable": made.get("believable"),
        "believable_real": truth["believable"],
        "label_recall": made["label_recall"],
        "label_recall_real": truth["label_recall"],
        "worst_kind": kinds[GENERATED]["worst"],
        "worst_ratio": worst.get("ratio"),
        "worst_ratio_kind": worst.get("kind"),
    }


def _criteria(result: Mapping[str, Any]) -> list[Row]:
    """What issue 24 wants of a generator on the test split."""
    summary, acts = result["summary"], {row["kind"]: row for row in result.get("recall_of_acts", ())}
    over, real_recall = {name: summary[f"{name}_over_real"] for name in OVER_REAL}, summary["label_recall_real"]
    return [
        at_least(
            "macro recall over that on real motions",
            0.9,
            summary["label_recall"] / real_recall if real_recall else None,
        ),
        at_least(f"worst recall over real: {summary['worst_ratio_kind']}", 0.75, summary["worst_ratio"]),
        *(
            at_least(f"second classifier, over real: {kind}", 0.75, acts.get(kind, {}).get("ratio"))
            for kind in NEW_ACTS
        ),
        *(
            at_most(f"reconstruction, {which} (m)", most, summary[name])
            for name, (which, most) in FAITHFUL.items()
            if name in summary
        ),
        within("mean acceleration over real", 0.8, 1.1, over["acceleration"]),
        within("largest acceleration over real", 0.8, 1.1, over["max_acceleration"]),
        at_most(f"power above {QUICK:g} Hz over real", 1.2, over["power"]),
        at_most("skating over real", 1.1, over["skating"]),
        at_most(
            "FID over that of the other weights",
            1.0,
            _ratio(summary["fid"], summary.get(f"fid_{BEFORE.replace(' ', '_')}")),
        ),
        at_least("believable, of prompts that ask for no scene", 0.95, summary["believable"]),
    ]


def _ratio(value: float | None, over: float | None) -> float | None:
    return value / over if over and value is not None else None


def plot(result: Mapping[str, Any], png: str | Path) -> None:
    """Confusion of kinds, real motions beside generated ones, to a picture."""
    from matplotlib.figure import Figure  # without pyplot, so that no window system is asked for

    figure = Figure(figsize=(15, 8.5), layout="constrained")
    shown = sorted({kind for name in ("real", "generated") for kind in result["kinds"][name]["recall"]})
    for axis, name in zip(figure.subplots(1, 2), ("real", "generated"), strict=True):
        found = result["kinds"][name]
        counts = _shares(found, shown)
        axis.imshow(counts.numpy(), cmap="Blues", vmin=0, vmax=1)
        axis.set_xticks(range(len(shown)), shown, rotation=90, fontsize=7)
        axis.set_yticks(range(len(shown)), shown, fontsize=7)
        axis.set(title=f"{name}: macro recall {found['macro_recall']:.2f}", xlabel="taken for", ylabel="is")
    with atomic_write(png) as file:
        figure.savefig(file, format=Path(png).suffix.lstrip(".") or "png", dpi=100)


def _shares(found: Mapping[str, Any], shown: Sequence[str]) -> Float[Tensor, "K K"]:
    """Share of each shown kind that was taken for each; what was taken for a kind not shown is left out."""
    counts = torch.tensor(found["confusion"], dtype=torch.float32)
    share = counts / counts.sum(1, keepdim=True).clamp_min(1)
    keep = [found["kinds"].index(kind) if kind in found["kinds"] else -1 for kind in shown]
    padded = torch.nn.functional.pad(share, (0, 1, 0, 1))
    return padded[keep][:, keep]
