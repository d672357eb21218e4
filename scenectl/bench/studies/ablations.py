"""The paper's ablations on our data: each trains or loads what it compares, and writes a table.

Small models are trained for a stated number of iterations, so their figures compare variants with each other and
with nothing else.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.bench.control.keyframes import DENSITIES, FAILED, Keyframes, usable_clips
from scenectl.bench.engine import Engine, Row
from scenectl.bench.models.asked import Asked, load_asked
from scenectl.bench.models.generator import bench_generator
from scenectl.bench.models.posterior import bench_posterior
from scenectl.bench.models.sentences import GENERATED, RECORDED, bench_sentences
from scenectl.control import SolverSettings
from scenectl.data.augment import GROUPS
from scenectl.data.clips import beginnings
from scenectl.data.corpus import Clip
from scenectl.data.features import body_joints, features_to_joints, on_body
from scenectl.data.sources import is_humanml3d
from scenectl.evaluation import SHIPPED
from scenectl.evaluation.kinds import ACTS, KindClassifier, load_classifier
from scenectl.generators import load_generator
from scenectl.generators.base import Generator, Progress
from scenectl.generators.mscot.config import RefinerConfig
from scenectl.generators.mscot.networks.refiner import Refiner
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.mscot.networks.transformer import ScaleTransformer
from scenectl.generators.mscot.sampling import MSCoT
from scenectl.generators.mscot.training.reconstruction import train_refiner
from scenectl.generators.mscot.training.stages import TRAINING, MSCoTRecipe, MSCoTRun, tokenizer_of
from scenectl.generators.mscot.training.transformer import train_transformer
from scenectl.measures.metrics import max_acceleration, skating_ratio
from scenectl.threads import use
from scenectl.training.errors import joints_after
from scenectl.training.placement import Placement, place
from scenectl.training.recipe import Variant, load_recipe
from scenectl.training.stages import Job, Run
from scenectl.training.sweep import Measure, digest, shortened, sweep, write_table
from scenes.errors import UserError

C = TypeVar("C")

WINDOW = MSCoT.spec.window_frames

SCHEDULES = {
    3: (1, 8, 16),
    4: (1, 5, 10, 16),
    5: (1, 4, 8, 12, 16),
    6: (1, 4, 7, 10, 13, 16),
    7: (1, 3, 6, 8, 11, 13, 16),
    8: (1, 3, 5, 7, 9, 11, 13, 16),
    9: (1, 2, 4, 6, 8, 10, 12, 14, 16),
    10: (1, 2, 3, 4, 5, 6, 8, 10, 13, 16),
    12: (1, 2, 3, 5, 6, 7, 9, 10, 11, 13, 14, 16),
    14: (1, 2, 3, 4, 5, 6, 7, 9, 10, 11, 12, 13, 14, 16),
    16: tuple(range(1, 17)),
}
"""Base schedule for each number of scales (Table 9)."""

REFINERS = {
    "4-layer MLP": {"kind": "mlp", "layers": 4},
    "8-layer MLP": {"kind": "mlp", "layers": 8},
    "2-layer transformer": {"kind": "transformer", "layers": 2},
    "3-layer transformer": {"kind": "transformer", "layers": 3},
}
"""Token refiners of Table 14."""

LEARNT = {"all": (), **{f"without {group}": (group,) for group in GROUPS}, "recorded only": tuple(GROUPS)}
"""What a transformer learns from, by the groups of made clips that are left out."""

ACTS_OF = {
    "standing": ("idle", "start", "stop", "turn in place"),
    "sitting": ("sit down", "sit", "stand up"),
    "climbing": ("climb",),
    "handling": ("pick up", "put down", "carry"),
    "bending": ("lean", "crouch", "duck", "sidestep", "reach", "reach while walking"),
}
"""Groups of acts whose recall is told; all other kinds are told as one."""

EVERY = 2
"""Of the sentences that ship, every so-manyth is asked for: 25."""


@dataclass(frozen=True)
class Bench:
    """What an ablation may use.

    Attributes:
        data: folder of the motion collection.
        out: folder of tables, figures and small models.
        config: recipe whose variants are trained.
        weights: finished weights, for what needs no training.
        iterations: of every stage of every small model.
        clips: test clips wherever joints are controlled.
        device: "auto", "cpu" or "cuda", for training.
        threads: CPU threads; torch's choice by default.
        family: of the generator that is taken apart.
        acts: folder of the second classifier of kinds, instead of ours.
    """

    data: Path
    out: Path
    config: str = "compact"
    weights: str = "default"
    iterations: int = 1000
    clips: int = 12
    device: str = "auto"
    threads: int | None = None
    family: str = MSCoT.name
    acts: Path | None = None

    @cached_property
    def recipe(self) -> MSCoTRecipe:
        return load_recipe(self.config, MSCoTRecipe)

    @cached_property
    def where(self) -> Placement:
        return place(self.device, self.recipe.precision)

    @cached_property
    def generator(self) -> MSCoT:
        """The finished weights behind the default sampling."""
        found = load_generator(self.family, self.weights)
        assert isinstance(found, MSCoT)
        return found

    @cached_property
    def test_clips(self) -> list[Clip]:
        """Captioned test clips of 64 frames or more, drawn with one seed."""
        usable = usable_clips(self.data, MSCoT.spec)
        order = torch.randperm(len(usable), generator=torch.Generator().manual_seed(0)).tolist()
        return [usable[i] for i in order[: self.clips]]

    def trained(
        self,
        variants: Sequence[Variant],
        progress: Progress,
        measure: Measure | None = None,
    ) -> list[Row]:
        """Rows of small models."""
        run = Run(TRAINING, self.recipe, self.data, self.out / "models", where=self.where)
        return sweep(run, variants, self.iterations, progress, measure)

    def rows(
        self, name: str, cases: Sequence[tuple[str, C]], measure: Callable[[C], Row], progress: Progress
    ) -> list[Row]:
        """A row for each case; those that an earlier run measured are taken again."""
        settings = {
            "ablation": name, "data": self.data, "config": self.config, "weights": self.weights,
            "iterations": self.iterations, "clips": self.clips, "acts": self.acts,
        }  # fmt: skip
        engine = Engine(progress, self.out / f"{name}.json")
        found: list[Row] = engine.run(cases, lambda case: [measure(case)], lambda rows: {}, settings)["rows"]
        return found

    def table(
        self, name: str, title: str, cases: Sequence[tuple[str, C]], measure: Callable[[C], Row], progress: Progress
    ) -> list[Path]:
        """`rows`, written."""
        return self.written(name, title, self.rows(name, cases, measure, progress))

    def written(self, name: str, title: str, rows: Sequence[Row]) -> list[Path]:
        """A table of rows, as Markdown and JSON."""
        write_table(rows, self.out / name, title)
        Engine(file=self.out / f"{name}.json").close()
        return [self.out / f"{name}.md", self.out / f"{name}.json"]


def bench_ablations(bench: Bench, names: Sequence[str], progress: Progress) -> list[Path]:
    """Run some of `ABLATIONS`; returns the files written. Raises UserError for a family that they do not take apart."""
    if bench.family != MSCoT.name:
        raise UserError(f"ablations take apart '{MSCoT.name}', and generator '{bench.family}' has none of its parts")
    if bench.threads is not None:
        use(bench.threads)
    written = []
    for name in names:
        written += ABLATIONS[name](bench, lambda what, done, name=name: progress(f"{name}: {what}", done))  # type: ignore[misc]
    return written


def adaptive(bench: Bench, progress: Progress) -> list[Path]:
    """Table 7: one schedule that follows the length, against chunks of 64 frames and against 196 frames always."""
    batch = bench.recipe.tokenizer.loop.batch
    variants = (
        Variant(name="adaptive"),
        Variant(name="fixed-64", set={"tokenizer.frames": [64]}),
        # as many frames a step as the others
        Variant(name="fixed-196", set={"tokenizer.frames": [WINDOW], "tokenizer.loop.batch": batch * 64 // WINDOW}),
    )
    chunks = {"adaptive": None, "fixed-64": 64, "fixed-196": WINDOW}

    def by_length(run: MSCoTRun) -> Mapping[str, Any]:
        chunk = chunks[next(name for name in chunks if run.out.name.startswith(f"{name}-"))]
        test, tokenizer = run.clips(["test"], False), tokenizer_of(run)
        found: dict[str, float] = {}
        for frames in (64, 128, WINDOW):
            features = beginnings(test, frames)
            got, true = joints_after(lambda x: in_chunks(tokenizer, x, chunk), features)
            found[f"clips_{frames}"] = len(features)
            found[f"error_{frames}_m"] = float((got - true).norm(dim=-1).mean())
            for name, joints in (("", got), ("real_", true)):
                found[f"{name}acceleration_{frames}_m_per_frame2"] = float(joints.diff(n=2, dim=1).norm(dim=-1).mean())
        return found

    rows = bench.trained(variants, progress, by_length)
    return bench.written("adaptive", "Adaptive scale against fixed scales, by length (the paper's Table 7)", rows)


@torch.no_grad()
def in_chunks(tokenizer: Tokenizer, features: Float[Tensor, "C T 263"], chunk: int | None) -> Float[Tensor, "C T 263"]:
    """Reconstruct in pieces of `chunk` frames, the last one filled up with its last row; None: in one piece."""
    clips, frames = features.shape[:2]
    size = frames if chunk is None else chunk
    padded = torch.cat([features, features[:, -1:].expand(-1, -frames % size, -1)], dim=1)
    pieces = padded.reshape(-1, size, features.shape[-1])
    got = torch.cat([tokenizer.decode(tokenizer.encode(part)) for part in pieces.split(64)])
    return got.reshape(clips, -1, features.shape[-1])[:, :frames]


def codebook(bench: Bench, progress: Progress) -> list[Path]:
    """Table 8: size and width of the codes, shared by all scales or not."""
    variants = [
        Variant(
            name=f"{'shared' if shared else 'own'}-{codes}-{dim}",
            set={
                "model.tokenizer.codes": codes,
                "model.tokenizer.code_dim": dim,
                "model.tokenizer.shared_codebook": shared,
            },
        )
        for shared in (True, False)
        for codes, dim in ((256, 128), (512, 64), (512, 128), (1024, 128))
    ]
    return bench.written(
        "codebook", "Codebook size and sharing (the paper's Table 8)", bench.trained(variants, progress)
    )


def scales(bench: Bench, progress: Progress) -> list[Path]:
    """Tables 10 and 11: number of scales, for reconstruction and for control."""
    variants = [Variant(name=f"K-{k}", set={"model.tokenizer.scales": s}) for k, s in SCHEDULES.items()]
    rows = bench.trained(variants, progress, _control_columns(bench))
    return bench.written("scales", "Number of scales (the paper's Tables 10 and 11)", rows)


def normalised(bench: Bench, progress: Progress) -> list[Path]:
    """Tables 4 and 12: unit codes with a gain for each scale against free ones, control and posterior."""
    variants = [
        Variant(name=name, set={"model.tokenizer.normalised": on}) for name, on in (("l2", True), ("euclidean", False))
    ]
    control = _control_columns(bench)

    def control_and_posterior(run: MSCoTRun) -> Mapping[str, Any]:
        found = control(run)
        generator = load_generator("mscot", run.out / "weights")
        return {**found, **bench_posterior(generator, 2, positions=1)["summary"]}

    rows = bench.trained(variants, progress, control_and_posterior)
    return bench.written("normalised", "Normalised against Euclidean codes (the paper's Tables 4 and 12)", rows)


def losses(bench: Bench, progress: Progress) -> list[Path]:
    """Residual losses: joint positions, velocities, feet, amplitudes."""
    silent = {
        f"tokenizer.reconstruction.{name}": 0.0 for name in ("joints", "feet", "velocities", "contacts", "amplitudes")
    }
    changes = {
        "recipe": {},
        "features-only": silent,
        "joints": {**silent, "tokenizer.reconstruction.joints": 4.0},
        "no-velocities": {"tokenizer.reconstruction.velocities": 0.0},
        "no-amplitudes": {"tokenizer.reconstruction.amplitudes": 0.0},
        "contacts": {"tokenizer.reconstruction.contacts": 10.0},
        "no-root": {"tokenizer.reconstruction.root": 0.0},
    }
    rows = bench.trained([Variant(name=name, set=change) for name, change in changes.items()], progress)
    return bench.written("losses", "Residual losses of the tokenizer", rows)


def _control_columns(bench: Bench) -> Measure:
    """Trains the other two networks and controls five pelvis keyframes with them."""

    def control(run: MSCoTRun) -> Mapping[str, Any]:
        run.train("refiner")
        run.train("transformer")
        run.export()
        return controlled(load_generator("mscot", run.out / "weights"), bench.test_clips, 5)

    return control


def refiner(bench: Bench, progress: Progress) -> list[Path]:
    """Table 14: token refiners on the finished weights' tokenizer."""
    bundle, recipe = bench.generator.bundle, shortened(TRAINING, bench.recipe, bench.iterations)
    run = Run(TRAINING, recipe, bench.data, bench.out / "models", where=bench.where)
    test = beginnings(run.clips(["test"], False), 64)

    def row(name: str) -> Row:
        config = RefinerConfig.model_validate({**recipe.model.refiner.model_dump(), **REFINERS[name]})
        folder = bench.out / "models" / f"refiner-{config.kind}-{config.layers}-{bench.iterations}"
        tokenizer, data = deepcopy(bundle.tokenizer), run.clips(["train"], True).on(bench.where.device)
        loop = train_refiner(config, tokenizer, recipe.refiner, Job(data, folder, recipe.seed, bench.where))
        trained = loop.averaged.cpu().eval().requires_grad_(False)
        assert isinstance(trained, Refiner)
        return {
            "refiner": name,
            "parameters_m": sum(p.numel() for p in trained.parameters()) / 1e6,
            **_refined(bundle.tokenizer, trained, test),
            **controlled(MSCoT(replace(bundle, refiner=trained)), bench.test_clips, 5),
        }

    title = f"Token refiners, {bench.iterations} iterations (the paper's Table 14)"
    return bench.table("refiner", title, [(name, name) for name in REFINERS], row, progress)


@torch.no_grad()
def _refined(tokenizer: Tokenizer, network: Refiner, features: Float[Tensor, "C T 263"]) -> dict[str, float]:
    """Reconstruction error without and with the refiner, and seconds of its own for one motion."""
    tokens = tokenizer.encode(features)
    quantiser, finest = tokenizer.quantiser, tokens[-1].shape[-1]
    codes = [quantiser.lookup(k, t) for k, t in enumerate(tokens)]
    began = time.perf_counter()
    for k, e in enumerate(codes):
        network(e[:1], k, finest)
    seconds = time.perf_counter() - began
    moved = [e + network(e, k, finest) for k, e in enumerate(codes)]
    found = {}
    for name, parts in (("unrefined_error_m", codes), ("reconstruction_error_m", moved)):
        decoded = tokenizer.decode_latent(quantiser.latent(parts, finest))
        got, true = body_joints(decoded), features_to_joints(on_body(features))
        found[name] = float((got - true).norm(dim=-1).mean())
    return {**found, "refiner_s": seconds}


def data(bench: Bench, progress: Progress) -> list[Path]:
    """What the transformer learns from: each group of made clips left out, all on the finished tokenizer.

    Raises:
        UserError: the second classifier is missing or does not know the sentences' acts, or the folder is HumanML3D.
    """
    if is_humanml3d(bench.data):
        raise UserError(f"folder '{bench.data}' is HumanML3D, of which nothing is made; name a motion collection")
    first, second, asked = load_classifier(), load_classifier(bench.acts or SHIPPED, ACTS), load_asked()
    some = asked.model_copy(update={"sentence": asked.sentence[::EVERY], "timeline": ()})
    some.check(second.kinds)
    recipe = shortened(TRAINING, bench.recipe, bench.iterations)

    def row(name: str) -> Row:
        varied = recipe.model_copy(update={"augmentation": recipe.augmentation.without(*LEARNT[name])})
        run = Run(TRAINING, varied, bench.data, bench.out / "models", where=bench.where)
        clips, folder = run.clips(["train"], True), run.out / f"transformer-{digest(varied)}"
        made = {"learns from": name, "hours": clips.hours, "clips": len(clips.ids)}
        return {**made, **judged(_relearnt(bench, run, folder), bench.data, first, second, some)}

    title = f"What the transformer learns from, {bench.iterations} iterations"
    return bench.table("data", title, [(name, name) for name in LEARNT], row, progress)


def _relearnt(bench: Bench, run: MSCoTRun, folder: Path) -> MSCoT:
    """The finished weights with a transformer of the recipe's, trained on a run's clips."""
    bundle, recipe, clips = bench.generator.bundle, run.recipe, run.clips(["train"], True).on(run.where.device)
    job = Job(clips, folder, recipe.seed, run.where, run.prepared)
    settings = recipe.model.transformer, deepcopy(bundle.tokenizer), run.encoder(), recipe.transformer
    trained = train_transformer(*settings, job).averaged.cpu().eval().requires_grad_(False)
    assert isinstance(trained, ScaleTransformer)
    return MSCoT(replace(bundle, transformer=trained, text=run.encoder("cpu")), bench.generator.sampling)


def judged(generator: Generator, data: Path, first: KindClassifier, second: KindClassifier, asked: Asked) -> Row:
    """Kinds of all test clips and acts of pieces of held-out recordings, motion beside real motion, sentences in order.

    Args:
        generator: what makes the motions, each once.
        data: the motion collection.
        first, second: classifiers of recorded kinds, and of acts.
        asked: sentences of several acts.
    """
    found = bench_generator(generator, None, first, data, acts=second)
    told = bench_sentences(generator, second, data, asked, samples=1)["summary"]["sentences"]
    keys = "label_recall", "label_recall_real", "skating_over_real", "acceleration_over_real", "believable"
    return {
        **{key: found["summary"][key] for key in keys},
        **_recall_of_groups(found["recall_of_acts"]),
        "sentences_in_order": told[GENERATED],
        "sentences_in_order_recorded": told[RECORDED],
    }


def _recall_of_groups(recall: Sequence[Row]) -> Row:
    """Share of the clips of each group of acts that were recognised, generated and real; None where there are none."""
    known = {kind for kinds in ACTS_OF.values() for kind in kinds}
    others = tuple(row["kind"] for row in recall if row["kind"] not in known)
    found: Row = {}
    for name, kinds in {**ACTS_OF, "other": others}.items():
        rows = [row for row in recall if row["kind"] in kinds]
        clips = sum(row["clips"] for row in rows)
        for key, of in (("generated", name), ("real", f"{name}_real")):
            right = sum(row["clips"] * (row[key] or 0.0) for row in rows)
            found[f"acts_{of}"] = right / clips if clips else None
    return found


def iterations(bench: Bench, progress: Progress) -> list[Path]:
    """Fig. 9: what more refinement buys, and what it costs."""
    from scenectl.bench.studies.figures import draw_trade_off

    cases = [(f"{number} iterations", number) for number in (0, 10, 25, 50, 100, 200)]

    def row(number: int) -> Row:
        solver = SolverSettings(iterations=number)
        return {"refinement_iterations": number, **controlled(bench.generator, bench.test_clips, 5, solver)}

    rows = bench.rows("iterations", cases, row, progress)
    picture = bench.out / "iterations.png"
    draw_trade_off(rows, picture)
    return [*bench.written("iterations", "Refinement iterations (the paper's Fig. 9)", rows), picture]


def refinement(bench: Bench, progress: Progress) -> list[Path]:
    """What of guidance and refinement is worth how much: each left out in turn."""
    whole = bench.generator
    alike = MSCoT(whole.bundle, whole.sampling.model_copy(update={"clip_coarsest": 1.0}))
    variants: dict[str, tuple[MSCoT, SolverSettings]] = {
        "as it is": (whole, SolverSettings()),
        "coarse scales tilted like fine ones": (alike, SolverSettings()),
        "without the decoder's metric": (MSCoT(replace(whole.bundle, metric=None), whole.sampling), SolverSettings()),
        "without polishing": (whole, SolverSettings(polish=False)),
        "without a body's costs": (whole, SolverSettings(natural=False)),
    }

    def row(name: str) -> Row:
        generator, solver = variants[name]
        return {"variant": name, **controlled(generator, bench.test_clips, 5, solver)}

    cases = [(name, name) for name in variants]
    return bench.table("refinement", "Guidance and refinement, one part left out in turn", cases, row, progress)


def densities(bench: Bench, progress: Progress) -> list[Path]:
    """Table 16: pelvis keyframes, from one to every frame."""
    cases = [(f"density {name}", (name, density)) for name, density in DENSITIES.items()]

    def row(case: tuple[str, int | float]) -> Row:
        return {"density": case[0], **controlled(bench.generator, bench.test_clips, case[1])}

    return bench.table("densities", "Control densities of the pelvis (the paper's Table 16)", cases, row, progress)


def controlled(
    generator: Generator,
    clips: Sequence[Clip],
    density: int | float,
    solver: SolverSettings | None = None,
    seed: int = 0,
) -> dict[str, float]:
    """Pelvis keyframes of real clips, pursued with the clips' own captions.

    Args:
        generator: what makes the motions.
        clips: real motions; their first 196 frames.
        density: keyframes in each, as a number, or as a share of the frames where it is a float.
        solver: of the refinement, instead of the default.
        seed: of frames and motions.

    Returns:
        Means over the clips: distance from the keyframes (m) and share missed by more than 0.5 m, the same distance
        before refinement, how far that moved all joints (m) and in how many passes, skating ratio and maximum
        acceleration (m/frame²) beside the real clips', median seconds.
    """
    draw, rows = torch.Generator().manual_seed(seed), []
    for i, clip in enumerate(clips):
        asked = Keyframes.drawn(clip, generator.spec, "pelvis", density, draw, seed + i)
        began = time.perf_counter()
        made = asked.made(generator, solver)
        seconds = time.perf_counter() - began
        before = made.motion if made.unrefined is None else made.unrefined
        error = asked.errors(made.motion)
        rows.append(
            {
                "average_error_m": float(error.mean()),
                "location_error": float((error > FAILED).float().mean()),
                "guided_only_error_m": float(asked.errors(before).mean()),
                "moved_m": float((made.motion.joints - before.joints).norm(dim=-1).mean()),
                "passes": float(made.solution.evaluations if made.solution else 0),
                "skating_ratio": float(skating_ratio(made.motion[0])),
                "skating_ratio_real": float(skating_ratio(asked.real)),
                "max_acceleration_m_per_frame2": float(max_acceleration(made.motion[0])),
                "max_acceleration_real_m_per_frame2": float(max_acceleration(asked.real)),
                "seconds": seconds,
            }
        )
    return {
        key: (statistics.median if key == "seconds" else statistics.fmean)(row[key] for row in rows) for key in rows[0]
    }


def figures(bench: Bench, progress: Progress) -> list[Path]:
    """Fig. 5 to 8: what the scales hold, what guidance does at each, which codes are used and which are tilted."""
    from scenectl.bench.studies.figures import draw_code_use, draw_scales, draw_spectrogram, draw_tilt, guided_scales
    from scenectl.data.sources import load_clips

    test = load_clips(bench.data, ["test"], None, bench.out / "models" / "data", 0)
    generator = bench.generator
    progress("spectrogram", 0.0)
    spectrogram, use = bench.out / "spectrogram.png", bench.out / "code-use.png"
    draw_spectrogram(generator.bundle.tokenizer, test, spectrogram)
    progress("code use", 0.3)
    draw_code_use(generator.bundle.tokenizer, test, use)
    progress("guidance", 0.5)
    guided = guided_scales(generator)
    poses, paths, tilt = (bench.out / name for name in ("scales-poses.png", "scales-paths.png", "tilt.png"))
    draw_scales(guided, poses, paths)
    draw_tilt(guided, tilt)
    return [spectrogram, use, poses, paths, tilt]


ABLATIONS: dict[str, Callable[[Bench, Progress], list[Path]]] = {
    each.__name__: each
    for each in (
        figures, iterations, densities, refinement, refiner, losses, codebook, normalised, adaptive, scales, data,
    )
}  # fmt: skip
"""By name, the cheap ones first."""
