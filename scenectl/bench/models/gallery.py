"""A page of what a generator makes of some prompts, three samples each."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from scenectl.bench.engine import ENGINE, Engine, Row
from scenectl.generators.base import Generator
from scenectl.generators.prompts import Prompt, Prompts
from scenectl.measures.metrics import Scorer, max_acceleration, skating_ratio, travelled
from scenectl.pipeline.run import run
from scenectl.tasks.task import load_task
from scenectl.view import of_result
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
    ("a person stands relaxed.", 6.0),
    ("a person walks forward and stops.", 5.0),
    ("a person sits down on a chair.", 4.0),
    ("a person sits on a chair.", 4.0),
    ("a person stands up from a chair.", 4.0),
    ("a person climbs the stairs.", 5.0),
    ("a person picks up a box from the floor.", 4.0),
    ("a person carries a box with both hands.", 5.0),
    ("a person walks forward, then sits down.", 6.0),
    ("a person ducks, stands up and waves.", 7.0),
    ("a person picks up a box, carries it and puts it down.", 8.0),
)
"""Prompts with their seconds: easy ones first, then what one does in a room, then several things one after another."""

TIMELINE = Prompts(
    (
        Prompt("a person stands still.", 0.0, 2.5),
        Prompt("a person walks forward.", 2.5, 6.0),
        Prompt("a person turns around on the spot.", 6.0, 8.5),
        Prompt("a person sits down.", 8.5, 12.0),
    )
)
"""Sentences with their times, for generators that take several."""

SMALL = (1120, 700)
"""Pixels of a picture on a page of tasks."""


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

    def drawn(case: tuple[str, Prompts, float]) -> list[Row]:
        picture, prompts, seconds = case
        motion = generator.generate(prompts, seconds, Pose2D(), samples=samples, seed=seed).motion
        draw_strips([(f"sample {s + 1}", motion.joints[s].numpy()) for s in range(samples)], folder / picture)
        return _rows(picture, _title(prompts), motion)

    asked = [(Prompts.of(prompt), seconds) for prompt, seconds in PROMPTS]
    if "sentences" in generator.spec.abilities:
        asked.append((TIMELINE, 12.0))
    cases = [(_title(told), (f"{i + 1:02d}.png", told, seconds)) for i, (told, seconds) in enumerate(asked)]
    result = engine.run(cases, drawn, lambda rows: {}, {"bench": "gallery", "samples": samples, "seed": seed})
    page = folder / "README.md"
    with atomic_write(page, "w") as file:
        file.write("\n".join(_page(result["rows"], samples, seed)))
    return page


def draw_tasks(
    generator: Generator, tasks: Sequence[Path], folder: Path, samples: int, seed: int, engine: Engine = ENGINE
) -> Path:
    """Write a picture of what each task file comes to, its best sample, and `README.md`; returns the page.

    Args:
        generator: instead of those that the tasks name.
        tasks: files.
        folder, samples, seed, engine: as `draw_gallery` takes them.

    Raises:
        UserError: a task that cannot be read or planned.
    """
    folder.mkdir(parents=True, exist_ok=True)
    scorers: dict[str, Scorer] = {}

    def drawn(file: Path) -> list[Row]:
        task = load_task(file)
        setup = task.build(seed, spec=generator.spec)
        scorer = scorers.setdefault(setup.scene.digest, Scorer(setup.scene, setup.body))
        result = run(task, samples, seed, generator=generator, setup=setup, scorer=scorer)
        of_result(result).draw(folder / f"{file.stem}.png", size=SMALL)
        first = result.samples[0]
        return [
            {
                "task": file.name, "says": _says(file), "seconds": result.motion.seconds,
                "good": sum(row.good for row in result.samples), "samples": samples,
                "verdict": first.verdict.sentence, "missed": [term.name for term in first.terms if not term.met],
                "generate_s": result.report["timing"]["generate_s"],
            }
        ]  # fmt: skip

    settings = {"bench": "gallery of tasks", "samples": samples, "seed": seed}
    rows = engine.run([(file.name, file) for file in tasks], drawn, lambda rows: {}, settings)["rows"]
    page = folder / "README.md"
    with atomic_write(page, "w") as file:
        file.write("\n".join(_page_of_tasks(rows, samples, seed)))
    return page


def _says(file: Path) -> str:
    """What a task's file says about it in its first line."""
    first = file.read_text(encoding="utf-8").partition("\n")[0]
    return first.removeprefix("#").strip() if first.startswith("#") else file.stem


def _page_of_tasks(rows: Sequence[Row], samples: int, seed: int) -> list[str]:
    lines = [
        f"# {len(rows)} tasks, {samples} samples each, the best of them drawn", "", f"Seed {seed}.", "",
        "| task | met and believable | motion | made in | the best one |", "|---|---|---|---|---|",
    ]  # fmt: skip
    for row in rows:
        fault = "" if not row["missed"] else f"; missed: {', '.join(row['missed'])}"
        lines.append(
            f"| [{row['task']}](#{row['task'].replace('.', '')}) | {row['good']} of {row['samples']} "
            f"| {row['seconds']:.1f} s | {row['generate_s']:.1f} s | {row['verdict']}{fault} |"
        )
    for row in rows:
        lines += ["", f"## {row['task']}", "", row["says"], "", f"![{row['task']}]({Path(row['task']).stem}.png)"]
    return [*lines, ""]


def _title(prompts: Prompts) -> str:
    """The sentences, with their times where there are several."""
    first, *rest = prompts.sentences
    if not rest:
        return first.text
    return " ".join(f"{each.text} ({each.begin:g} to {each.end:g} s)" for each in prompts.sentences)


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
    lines = [
        f"# {len({row['prompt'] for row in rows})} prompts, {samples} samples each",
        "",
        f"Seed {seed}; nothing is picked.",
        "",
    ]
    for number, (prompt, mine) in enumerate(groupby(rows, lambda row: str(row["prompt"])), start=1):
        some = list(mine)
        table = [
            f"| {row['sample']} | {row['way_m']:.2f} m | {row['skating']:.2f} | {row['acceleration']:.3f} |"
            for row in some
        ]
        lines += [f"## {number}. {prompt}", "", f"![{prompt}]({some[0]['picture']})", ""]
        lines += ["| sample | path | skating | max. acceleration (m/frame²) |", "|---|---|---|---|", *table, ""]
    return lines
