"""What a recipe trains on: how much of every kind of motion, and pictures of what is found, edited and composed."""

from __future__ import annotations

import random
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.data import held_out
from scenectl.data.augment import augmented
from scenectl.data.clips import weights
from scenectl.data.corpus import Clip, load_motions
from scenectl.data.features import FPS
from scenectl.data.kinds import EDITS, is_recorded, kind_of
from scenectl.generators.training import plan_of
from scenectl.training.recipe import Recipe, load_recipe
from scenectl.view.strips import draw_strips
from scenes.errors import UserError
from scenes.files import atomic_write

SECONDS = (2, 4, 8)
"""Lengths of windows whose draws are counted: a transformer sees 1.8 to 9.8 s."""
SHOWN, POSES = 3, 10
"""Clips of a kind in its picture, drawn at random, and poses of each."""


def bench_data(
    data: Path, config: str | Path, seed: int = 0, page: Path | None = None, engine: Engine = ENGINE
) -> Result:
    """Census of the training clips of a recipe, and its page.

    Args:
        data: folder of the motion collection.
        config: a recipe by name, or its file.
        seed: of the pictures' choice; clips are made with the recipe's own.
        page: folder of ``data.md`` and its pictures, made where it does not exist; None writes none.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary", "rows"}``, a row for each kind of motion: hours, clips, median length (s), the share of its clips
        that are found, edited or composed, and its share (%) of the windows of each length in `SECONDS`.
    """
    recipe = load_recipe(config, plan_of(config).recipe)
    clips = [c for c in load_motions(data) if c.commercial_ok or not recipe.commercial_only]
    clips = [clip for clip in augmented(clips, recipe.augmentation, recipe.seed) if clip.captions]
    kinds = sorted({kind_of(clip) for clip in clips})
    shares = {seconds: _shares(clips, kinds, seconds) for seconds in SECONDS}

    def row(kind: str) -> list[Row]:
        some = [clip for clip in clips if kind_of(clip) == kind]
        lengths = [clip.frames / FPS for clip in some]
        made = sum(not is_recorded(clip.id) for clip in some) / len(some)
        of_draws = {f"share_{s}s": 100 * share.get(kind, 0.0) for s, share in shares.items()}
        about = {"kind": kind, "hours": sum(lengths) / 3600, "clips": len(some), "median_s": float(np.median(lengths))}
        return [about | {"found_or_made": made} | of_draws]

    settings = {"bench": "data", "data": data, "config": recipe.model_dump_json()}
    result = engine.run([(kind, kind) for kind in kinds], row, _summary, settings)
    if page is not None:
        _write(page, clips, result, recipe, random.Random(seed))
    return result


def _shares(clips: Sequence[Clip], kinds: Sequence[str], seconds: int) -> dict[str, float]:
    """Share of the windows so long that each kind has."""
    number = {kind: i for i, kind in enumerate(kinds)}
    groups = [kind_of(clip) for clip in clips]
    try:
        each = weights(torch.tensor([clip.frames for clip in clips]), groups, int(seconds * FPS))
    except UserError:  # no clip is so long
        return {}
    summed = torch.zeros(len(kinds)).index_add_(0, torch.tensor([number[kind] for kind in groups]), each) / each.sum()
    return dict(zip(kinds, summed.tolist(), strict=True))


def _summary(rows: Sequence[Row]) -> dict[str, float]:
    made = [row for row in rows if row["kind"] in EDITS.values()]
    shares = {f"made_share_{s}s": sum(row[f"share_{s}s"] for row in made) for s in SECONDS}
    return {"hours": sum(row["hours"] for row in rows), "clips": sum(row["clips"] for row in rows), **shares}


def _write(folder: Path, clips: Sequence[Clip], result: Result, recipe: Recipe, draw: random.Random) -> None:
    """The page, and a picture for each kind that is found, edited or composed."""
    folder.mkdir(parents=True, exist_ok=True)
    by_id = {clip.id: clip for clip in clips}
    pictures = {}
    for kind in sorted({*EDITS.values()} & {row["kind"] for row in result["rows"]}):
        some = [clip for clip in clips if kind_of(clip) == kind and not is_recorded(clip.id) and "~m" not in clip.id]
        chosen = draw.sample(some, min(SHOWN, len(some)))
        if not chosen:
            continue
        before = by_id.get(source_of(chosen[0].id))
        rows = [("as recorded: " + before.captions[0], before.joints.numpy())] if before and before.captions else []
        rows += [(clip.captions[0], clip.joints.numpy()) for clip in chosen]
        pictures[kind] = f"{kind.replace(' ', '-')}.png"
        draw_strips(rows, folder / pictures[kind], POSES)
    with atomic_write(folder / "data.md", "w") as file:
        file.write("\n".join(_page(result, recipe, pictures)))


def source_of(name: str) -> str:
    """Id of what a found or edited clip was made of: the recording, or the piece of one."""
    return re.sub(r"~[^~]*$", "", name) if "+" not in name else ""


def _page(result: Result, recipe: Recipe, pictures: Mapping[str, str]) -> list[str]:
    summary, takes = result["summary"], ", ".join(f"{name} ({what})" for (_, name), what in held_out.TAKES.items())
    heads = ("kind", "hours", "clips", "median (s)", *(f"of draws, {s} s" for s in SECONDS))
    lines = [
        f"# What `{recipe.name}` trains on",
        "",
        "`scenectl bench data --data MOTIONS --config NAME --page FOLDER` prints this page and draws its pictures. The",
        "settings are those of the recipe's `[augmentation]`.",
        "",
        "- **Recorded** clips of the collection's train split, mirrored, bent, slower and faster, some repeated.",
        "- **Found** (`scenectl/data/found`): pieces of recordings that show one act, cut out by how bodies move:",
        "  idle, stop, start, turn in place, sit down, sit, stand up, climb, pick up, put down. Rests are held by",
        "  going back and forth through them, with a sway, never frozen.",
        "- **Edited** (`scenectl/data/edits`) by foot-locked inverse kinematics: crouch, duck, reach, side-step,",
        "  steps, seats of other heights, picking up, putting down, carrying, leaning. Edits that jolt are left out.",
        "- **Composed** (`scenectl/data/compose`): two to four acts one after another, joined where poses and",
        "  velocities match, with sentences that say them in order.",
        "",
        f"Set aside, and never trained on: the collection's test split and these takes: {takes}.",
        "",
        f"{summary['clips']} clips, {summary['hours']:.1f} hours. A kind's share of the draws is the square root of its"
        " size; windows are as long as the column says, and clips that are shorter are not drawn for it.",
        "",
        *(f"| {' | '.join(cells)} |" for cells in (heads, ["---"] * len(heads), *map(_cells, result["rows"]))),
        "",
    ]
    for kind, picture in pictures.items():
        lines += [f"## {kind}", "", f"![{kind}]({picture})", ""]
    return lines


def _cells(row: Row) -> list[str]:
    shares = [f"{row[f'share_{s}s']:.1f} %" for s in SECONDS]
    return [row["kind"], f"{row['hours']:.2f}", str(row["clips"]), f"{row['median_s']:.1f}", *shares]
