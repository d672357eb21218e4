"""All that is measured about a generator, in one run, beside real motions, reconstructions and random tokens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.bench.models.posterior import bench_posterior
from scenectl.bench.models.tokenizer import bench_tokenizer
from scenectl.data.clips import overlapping
from scenectl.data.features import FPS
from scenectl.data.sources import load_clips
from scenectl.evaluation.evaluator import Evaluator
from scenectl.evaluation.kinds import Confusion, KindClassifier
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
from scenectl.measures.plausibility import plausibility
from scenes.files import atomic_write
from scenes.motion.motion import Pose2D
from scenes.sdf.bake import default_cache

MULTIMODAL = (20, 10)
"""Prompts and motions of each behind multimodality."""


def bench_generator(
    generator: Generator,
    evaluator: Evaluator,
    classifier: KindClassifier,
    data: Path,
    clips: int | None = None,
    repeats: int = 20,
    seed: int = 0,
    engine: Engine = ENGINE,
) -> Result:
    """Evaluate a model on the test split.

    One motion is generated for each test clip, from its caption and of its length. R-precision and diversity are
    repeated over what is drawn; FID is repeated over bootstrap samples of both sets beside its value on the whole sets.

    Args:
        generator: the model.
        evaluator: behind FID, R-precision, distances; its name stands in the result.
        classifier: of kinds of motion, frozen.
        data: folder of the motion collection, or of HumanML3D.
        clips: at most so many test clips, by default all.
        repeats: of everything random.
        seed: of generated motions and draws.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary", "rows", "evaluator", "clips", "kinds"}``, a row for each set, and of MSCoT's tokens "code_use",
        "reconstruction" and "posterior".
    """
    test = HeldOut.of(load_clips(data, ["test"], None, _cache(), 0), generator.spec, seed, clips)
    # Too few clips, or captions that the evaluator cannot read, are found before minutes go into motions.
    check_enough(len(test.captions))
    evaluation = _Evaluation(generator, evaluator, classifier, test, repeats, seed, engine.progress)
    names = ("real", *(("reconstruction", "random tokens") if isinstance(generator, Tokenised) else ()), "generated")
    result = engine.run(
        [(f"motions: {name}", name) for name in names],
        evaluation.rows,
        _summary,
        {
            "bench": "generator", "evaluator": evaluator.name, "data": data, "clips": clips, "repeats": repeats,
            "seed": seed,
        },
    )  # fmt: skip
    result["kinds"] = {row["set"]: row.pop("kinds") for row in result["rows"]}
    tokens = _tokens(generator, data, seed, engine.whole) if isinstance(generator, MSCoT) else {}
    result["summary"] |= tokens.pop("summary", {})
    return {**result, "evaluator": evaluator.name, "clips": len(test.captions), **tokens}


@dataclass(frozen=True, eq=False)
class _Evaluation:
    """What the sets of motions have in common."""

    generator: Generator
    evaluator: Evaluator
    classifier: KindClassifier
    test: HeldOut
    repeats: int
    seed: int
    progress: Progress

    @cached_property
    def texts(self) -> Float[Tensor, "N d"]:
        return self.evaluator.embed_texts(self.test.captions)

    @cached_property
    def truth(self) -> Float[Tensor, "N d"]:
        """Points of the real motions."""
        return self.evaluator.embed_motions(real(self.test).features)

    def motions(self, name: str) -> MotionSet:
        """The set of that name."""
        if name == "real":
            return real(self.test)
        if name == "generated":
            return generated(self.test, self.generator, self.seed, self.progress)
        assert isinstance(self.generator, Tokenised)
        if name == "reconstruction":
            return reconstructed(self.test, self.generator)
        return of_random_tokens(self.test, self.generator, self.seed)

    def rows(self, name: str) -> list[Row]:
        """Everything about one set."""
        motions = self.motions(name)
        row = _row(
            motions, self.evaluator.embed_motions(motions.features), self.truth, self.texts, self.repeats, self.seed
        )
        if name == "generated":
            row["multimodality"] = _multimodality(self.generator, self.evaluator, self.test, self.seed)
        confusion = Confusion.of(self.test.kinds, self.classifier.predict(motions.features))
        return [{**row, "label_recall": confusion.macro_recall, "kinds": _kinds(confusion)}]


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


def _row(
    motions: MotionSet,
    points: Float[Tensor, "N d"],
    truth: Float[Tensor, "N d"],
    texts: Tensor,
    repeats: int,
    seed: int,
) -> Row:
    """Everything about one set; intervals are half-widths at 95 %."""
    ranks = [r_precision(texts, points, torch.Generator().manual_seed(seed + i)) for i in range(repeats)]
    top3 = repeated(lambda draw: float(ranks[draw.initial_seed() - seed][2]), repeats, seed)
    varied = repeated(lambda draw: diversity(points, draw), repeats, seed)
    spread = repeated(lambda draw: _bootstrapped(points, truth, draw), repeats, seed)
    figures = {name: float(value.mean()) for name, value in plausibility(motions.padded).items()}
    return {
        "set": motions.name,
        "fid": frechet_distance(points, truth),
        **_estimate("fid_bootstrap", spread),
        "r_precision_top1": float(torch.stack(ranks)[:, 0].mean()),
        "r_precision_top2": float(torch.stack(ranks)[:, 1].mean()),
        **_estimate("r_precision_top3", top3),
        "multimodal_distance": multimodal_distance(texts, points),
        **_estimate("diversity", varied),
        "multimodality": None,
        **figures,
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


def _summary(rows: Sequence[Row]) -> dict[str, Any]:
    by_name = {row["set"]: row for row in rows}
    truth, made = by_name["real"], by_name["generated"]
    return {
        "skating_ratio": made["skating_ratio"],
        "skating_ratio_real": truth["skating_ratio"],
        "max_acceleration_m_per_frame2": made["max_acceleration_m_per_frame2"],
        "max_acceleration_real_m_per_frame2": truth["max_acceleration_m_per_frame2"],
        "bone_length_drift_m": made["bone_length_drift_m"],
        "limb_ends_moved_m": made["limb_ends_moved_m"],
        "fid": made["fid"],
        **{f"fid_{name.replace(' ', '_')}": row["fid"] for name, row in by_name.items() if row not in (truth, made)},
        "r_precision_top3": made["r_precision_top3"],
        "r_precision_top3_real": truth["r_precision_top3"],
        "label_recall": made["label_recall"],
        "label_recall_real": truth["label_recall"],
        "worst_kind": made["kinds"]["worst"],
    }


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
