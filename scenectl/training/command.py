"""What `scenectl train` does: a family's stages in order, each in its own folder, then weights and a model card."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scenectl.data.sources import is_humanml3d
from scenectl.threads import use
from scenectl.training.placement import place
from scenectl.training.recipe import load_recipe
from scenectl.training.stages import Run, Training
from scenes.errors import UserError, did_you_mean


def train(
    stage: str,
    data: str | Path,
    config: str | Path = "compact",
    out: str | Path = "runs/compact",
    iterations: int | None = None,
    text: str | None = None,
    threads: int | None = None,
    device: str = "auto",
    weights: str | Path | None = None,
    start: str | Path | None = None,
    *,
    plan: Training[Any],
) -> Path:
    """Train one stage, or all of them, and export weights.

    A stage goes on where it was killed. Stages need the ones before them in `out`.

    Args:
        stage: one of the plan's `commands` (its stages, "export", and what is measured on exported weights), or "all".
        data: folder of the motion collection, or of HumanML3D.
        config: name of a bundled recipe, or a TOML file.
        out: folder of the run; a stage's state lies in a folder of its own inside.
        iterations: instead of the recipe's, for a single stage.
        text: text encoder instead of the recipe's (a folder with CLIP, say); the networks take its width.
        threads: CPU threads; torch's choice by default.
        device: "cpu", "cuda", or "auto"; a run may go on elsewhere than where it began.
        weights: exported ones (a folder, or the name of bundled ones), whose networks stand for stages that `out` has
            not trained: to train one stage of finished weights anew.
        start: exported ones, at whose networks training begins instead of at random ones: to go on with finished
            weights, on other data or with another recipe.
        plan: of the recipe's family (`scenectl.generators.training.plan_of`).

    Returns:
        The folder of the run, whose `weights/` holds what `load_generator` reads.
    """
    known = ("all", *plan.commands)
    if stage not in known:
        raise UserError(f"unknown stage '{stage}'{did_you_mean(stage, known)}")
    recipe, out = load_recipe(config, plan.recipe), Path(out)
    if stage == "all" and iterations is not None:
        raise UserError("iterations can be given for a single stage only; name it instead of 'all'")
    if threads is not None:
        use(threads)
    if text is not None:
        recipe = plan.with_text(recipe, text)
    run = Run(plan, recipe, Path(data), out, iterations, place(device, recipe.precision), weights, start)
    if stage in {each.name for each in plan.stages} - run.stages.keys():
        raise UserError(f"training config '{config}' leaves {stage} out; give it a table [{stage}], or name another")
    names = [*run.stages, "export"] if stage == "all" else [stage]
    is_humanml3d(Path(data))  # a wrong folder or encoder is found now rather than after hours
    if any(run.stages[name].reads_text for name in names if name in run.stages):
        run.encoder()
    for name in names:
        if name == "export":
            run.export()
        elif name in plan.measured:
            run.measure(name)
        else:
            run.train(name)
    return out
