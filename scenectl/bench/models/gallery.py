"""A page of what a generator makes of twelve prompts, three samples each."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from scenectl.bench.engine import ENGINE, Engine, Row
from scenectl.generators.base import Generator
from scenectl.measures.metrics import max_acceleration, skating_ratio, travelled
from scenectl.view.strips import draw_strips
from scenes.files import atomic_write
from scenes.motion.motion import Motion, Pose2D

PROMPTS = (
    ("a person walks forward.", 5.0),
    ("a person walks forward and turns left.", 5.0),
    ("a person runs forward.", 3.0),
    ("a person walks forward in a crouch.", 5.0),
    ("a person walks forward and ducks under something.", 5.0),
    ("a person sidesteps to the left.", 4.0),
    ("a person waves with the right hand.", 4.0),
    ("a person raises both hands.", 4.0),
    ("a person bows.", 4.0),
    ("a person walks forward and reaches up with the left hand.", 5.0),
    ("a person squats down.", 3.0),
    ("a person sits down on a chair.", 4.0),
)
"""Twelve prompts with their seconds: easy ones first, some that are in no data last."""


def draw_gallery(generator: Generator, folder: Path, samples: int, seed: int, engine: Engine = ENGINE) -> Path:
    """Write a picture for each prompt and `README.md` with the figures of every sample; returns the page.

    Args:
        generator: what is shown.
        folder: made where it does not exist.
        samples: motions a prompt.
        seed: of the motions.
        engine: tells progress, keeps rows and goes on from them.
    """
    folder.mkdir(parents=True, exist_ok=True)

    def drawn(case: tuple[str, str, float]) -> list[Row]:
        picture, prompt, seconds = case
        motion = generator.generate(prompt, seconds, Pose2D(), samples=samples, seed=seed).motion
        draw_strips([(f"sample {s + 1}", motion.joints[s].numpy()) for s in range(samples)], folder / picture)
        return _rows(picture, prompt, motion)

    cases = [(prompt, (f"{i + 1:02d}.png", prompt, seconds)) for i, (prompt, seconds) in enumerate(PROMPTS)]
    result = engine.run(cases, drawn, lambda rows: {}, {"bench": "gallery", "samples": samples, "seed": seed})
    page = folder / "README.md"
    with atomic_write(page, "w") as file:
        file.write("\n".join(_page(result["rows"], samples, seed)))
    return page


def _rows(picture: str, prompt: str, motion: Motion) -> list[Row]:
    """Figures of every sample of one prompt."""
    figures = zip(
        travelled(motion).tolist(), skating_ratio(motion).tolist(), max_acceleration(motion).tolist(), strict=True
    )
    return [
        {"prompt": prompt, "picture": picture, "sample": s + 1, "way_m": way, "skating": skating, "acceleration": peak}
        for s, (way, skating, peak) in enumerate(figures)
    ]


def _page(rows: Sequence[Row], samples: int, seed: int) -> list[str]:
    lines = [f"# Twelve prompts, {samples} samples each", "", f"Seed {seed}; nothing is picked.", ""]
    for number, (prompt, mine) in enumerate(groupby(rows, lambda row: str(row["prompt"])), start=1):
        some = list(mine)
        table = [
            f"| {row['sample']} | {row['way_m']:.2f} m | {row['skating']:.2f} | {row['acceleration']:.3f} |"
            for row in some
        ]
        lines += [f"## {number}. {prompt}", "", f"![{prompt}]({some[0]['picture']})", ""]
        lines += ["| sample | path | skating | max. acceleration (m/frame²) |", "|---|---|---|---|", *table, ""]
    return lines
