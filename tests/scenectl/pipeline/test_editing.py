"""Edits: what is kept is exact, what is not is new, seams are smooth, mistakes are sentences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from scenectl.control import Figure
from scenectl.generators.base import Draft, Editor
from scenectl.generators.mscot.keeping import bridged
from scenectl.generators.mscot.sampling import MSCoT
from scenectl.generators.prompts import Prompt, Prompts
from scenectl.pipeline.editing import edit, edited, mask_of
from scenectl.pipeline.going_on import on_clock
from scenectl.pipeline.seams import settled
from scenectl.tasks.task import Task
from scenes.errors import UserError
from scenes.motion.bones import bone_lengths, rest_lengths
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.skeleton import HUMANML3D, Skeleton, with_lengths
from tests.scenectl.small import bundle, walk

FRAMES = 60
WALK = Motion(walk(FRAMES)).placed(Pose2D((1.0, 0.4, -2.0), 0.8))
SPANS = {"between": (20, 40), "prefix": (0, 25), "suffix": (35, 60)}


def mask(*spans: tuple[int, int], frames: int = FRAMES) -> Tensor:
    out = torch.zeros(frames, dtype=torch.bool)
    for start, end in spans:
        out[start:end] = True
    return out


@pytest.fixture(scope="module")
def generator() -> MSCoT:
    return MSCoT(bundle())


@pytest.mark.parametrize("kind", SPANS)
def test_kept_frames_come_back_and_seams_are_no_rougher_than_inside(generator: MSCoT, kind: str) -> None:
    gone = mask(SPANS[kind])
    got = edit(generator, WALK, gone, "a person walks", samples=2, iterations=5).motion.joints
    assert isinstance(generator, Editor) and got.shape == (2, FRAMES, 22, 3) and torch.isfinite(got).all()
    torch.testing.assert_close(got[:, ~gone], WALK.joints[~gone].expand(2, -1, -1, -1), atol=1e-5, rtol=0)
    rough = (got[:, 2:] - 2 * got[:, 1:-1] + got[:, :-2]).norm(dim=-1).amax((0, 2))
    seam = torch.zeros(FRAMES - 2, dtype=torch.bool)
    for edge in torch.nonzero(gone[1:] != gone[:-1]).flatten().tolist():
        seam[edge - 1 : edge + 1] = True
    # Bones of one length leave a seam as it was (0.17 of random networks) and smooth what lies between (0.23 to 0.13).
    assert rough[seam].max() <= 1.4 * rough[~seam].max()


def test_seeds_and_prompts_decide_what_is_new(generator: MSCoT) -> None:
    gone = mask((20, 40))
    one, same, seed, prompt = (
        edit(generator, WALK, gone, words, seed=s, iterations=0).motion.joints
        for words, s in (("a person walks", 1), ("a person walks", 1), ("a person walks", 2), ("someone sits", 1))
    )
    assert torch.equal(one, same)
    for other in (seed, prompt):
        assert (one - other)[:, gone].abs().max() > 1e-3 and (one - other)[:, ~gone].abs().max() < 1e-5


def test_what_the_motion_holds_where_it_is_made_anew_is_of_no_account(generator: MSCoT) -> None:
    gone = mask((15, 22), (40, 60))
    other = replace(WALK, joints=torch.where(gone[:, None, None], WALK.joints + torch.randn(22, 3), WALK.joints))
    first, second = (edit(generator, m, gone, "a person walks", iterations=0).motion.joints for m in (WALK, other))
    torch.testing.assert_close(first, second, atol=1e-5, rtol=0)


def test_an_edit_moves_with_its_motion(generator: MSCoT) -> None:
    there = Pose2D((3.0, -0.2, 1.0), 2.0)
    gone = mask((0, 20))
    here, moved = (edit(generator, m, gone, "a person walks", iterations=0).motion for m in (WALK, WALK.placed(there)))
    torch.testing.assert_close(moved.joints, here.placed(there).joints, atol=2e-3, rtol=0)


def test_refinement_draws_the_kept_frames_onto_the_original(generator: MSCoT) -> None:
    gone = mask((20, 40))
    raw, fitted = (generator_edit(generator, gone, n) for n in (0, 20))
    assert fitted < 0.7 * raw


def generator_edit(generator: MSCoT, gone: Tensor, iterations: int) -> float:
    from scenectl.control import SolverSettings
    from scenectl.pipeline.editing import SeamGuide, refined

    guide = SeamGuide(WALK, ~gone)
    step = generator.edit(WALK, gone, "a person walks", guide=guide).step
    assert step is not None
    return float(guide.cost(refined(step, guide, SolverSettings(iterations=iterations))))


def test_a_jump_dies_away_within_the_gap() -> None:
    made = replace(WALK, joints=WALK.joints[None] + 0.3, valid=WALK.valid[None])
    step = (settled(WALK, made, mask((40, 60))).joints[0] - WALK.joints)[:, 0, 0]
    assert step[:40].abs().max() < 1e-6 and step.diff().abs().max() < 0.03 and step[-1] > 0.29
    both = settled(WALK, made, mask((20, 40))).joints[0]  # a mere shift is undone between two seams
    torch.testing.assert_close(both, WALK.joints, atol=1e-5, rtol=0)


def test_gaps_are_bridged_by_lines() -> None:
    line = torch.arange(10.0)[:, None, None].expand(10, 2, 3)
    gone = mask((0, 2), (4, 6), (9, 10), frames=10)
    broken = torch.where(gone[:, None, None], torch.nan, line)
    want = torch.tensor([2.0, 2, 2, 3, 4, 5, 6, 7, 8, 8])
    assert torch.equal(bridged(broken, gone)[:, 0, 0], want)


BAD: dict[str, tuple[Any, Any, str]] = {
    "nothing anew": (WALK, mask(), "no frame anew"),
    "all anew": (WALK, mask((0, 60)), "keeps no frame"),
    "another length of mask": (WALK, mask(frames=59), "the motion has 60 frames"),
    "short": (Motion(walk(30)), mask((3, 9), frames=30), "30 frames"),
    "long": (Motion(walk(2401)), mask((3, 9), frames=2401), "2401 frames; an edit takes 36 to 2400"),
    "other rate": (replace(WALK, fps=30.0), mask((3, 9)), "30 frames a second"),
    "a batch": (Motion(WALK.joints[None]), mask((3, 9)), "one motion"),
    "other size": (Motion(WALK.joints * 2), mask((3, 9)), "2.00 times as long as an adult's"),
    "not finite": (Motion(WALK.joints * torch.nan), mask((3, 9)), "not finite"),
    "other joints": (
        replace(WALK, skeleton=Skeleton(tuple(f"j{i}" for i in range(22)), HUMANML3D.parents, HUMANML3D.offsets)),
        mask((3, 9)),
        "another skeleton",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_mistakes_are_sentences(generator: MSCoT, case: str) -> None:
    motion, gone, words = BAD[case]
    with pytest.raises(UserError, match=words):
        edit(generator, motion, gone, "a person walks")


def test_a_generator_that_cannot_edit_says_so(tiny: Any) -> None:
    with pytest.raises(UserError, match="'tiny' cannot edit"):
        edit(tiny.TinyGenerator(), WALK, mask((3, 9)), "a person walks")


def test_spans_are_seconds() -> None:
    assert torch.equal(mask_of(WALK, [(0.5, 1.0), (2.0, 3.0)]), mask((10, 20), (40, 60)))
    assert torch.equal(mask_of(replace(WALK, t0=7.0), [(7.5, 8.0)]), mask((10, 20)))
    for span in ((7.0, 8.0), (2.0, 3.1)):
        with pytest.raises(UserError, match=f"{span[0]:g}-{span[1]:g} goes beyond the motion, which lasts 3 s"):
            mask_of(WALK, [span])


LONG = Motion(walk(440)).placed(Pose2D((1.0, 0.4, -2.0), 0.8))


@pytest.mark.parametrize("spans", [[(50, 420)], [(0, 250)], [(10, 20), (400, 430)]], ids=str)
def test_motions_longer_than_a_window_are_edited_in_several(generator: MSCoT, spans: list[tuple[int, int]]) -> None:
    gone = mask(*spans, frames=440)
    lost = replace(LONG, joints=torch.where(gone[:, None, None], 900.0, LONG.joints))  # what is there is of no account
    got = edit(generator, lost, gone, "a person walks", samples=2, iterations=0).motion.joints
    assert got.shape == (2, 440, 22, 3) and torch.isfinite(got).all() and got.abs().max() < 800
    torch.testing.assert_close(got[:, ~gone], LONG.joints[~gone].expand(2, -1, -1, -1), atol=1e-5, rtol=0)
    assert (got[0] - got[1])[gone].abs().amax((1, 2)).min() > 0


def joint_target(at: float) -> Task:
    goal = {"use": "joint_target", "joint": "pelvis", "position": [1.4, -1.5], "at": at}
    return Task(prompt="x", seconds=3.0, goal=[goal])


def test_goals_of_a_task_are_met_where_the_motion_is_made_anew(generator: MSCoT) -> None:
    gone = mask((20, 60))
    free, led = (edited(generator, WALK, gone, "a person walks", task=task) for task in (None, joint_target(2.9)))
    at = torch.tensor([1.4, -1.5])
    misses = [float((r.motion.joints[0, 58, 0, [0, 2]] - at).norm()) for r in (free, led)]
    assert misses[1] < 0.3 * misses[0]
    assert led.report["task"]["goals"][0]["use"] == "joint_target" and led.report["prompt"] == "a person walks"
    with pytest.raises(UserError, match=r"time 3\.2 s lies outside"):
        edited(generator, WALK, gone, "a person walks", task=joint_target(3.2))


def test_a_clock_of_another_rate_and_padding_are_taken_off() -> None:
    motion = Motion(walk(120), torch.arange(120) < 90, fps=30.0)
    taken = on_clock(motion, 20.0)
    assert taken.fps == 20.0 and taken.frames == 60 and taken.valid.all()
    assert on_clock(WALK, 20.0).joints.equal(WALK.joints)


def test_the_command_writes_a_result(
    scenectl: Callable[..., Any], generator: MSCoT, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("scenectl.generators.load_generator", lambda *args, **kwargs: generator)
    WALK.save(tmp_path / "motion.npz")
    words = ("edit", tmp_path, "--keep", "0-1.5", "--prompt", "someone sits", "-o", tmp_path / "out")
    said = scenectl(*words, "--samples", 2, "--no-preview", "--allow-unmet")
    assert said.status == 0 and "30 of 60 frames anew; wrote motion.npz, report.json in" in said.out
    made = Motion.load(tmp_path / "out" / "motion.npz")
    torch.testing.assert_close(made.joints[:, :30], WALK.joints[:30].expand(2, -1, -1, -1), atol=1e-5, rtol=0)
    said = scenectl("edit", tmp_path, "--keep", "0-3", "--prompt", "x", "-o", tmp_path / "out")
    assert said.status == 2 and "no frame anew" in said.err


def other_person(factor: float) -> Motion:
    """The walk by somebody of other proportions, the arms longer than that."""
    lengths = HUMANML3D.bone_lengths * np.array([1.1 if "elbow" in n or "wrist" in n else 1.0 for n in HUMANML3D.names])
    figure = Figure.between(HUMANML3D, with_lengths(HUMANML3D, factor * lengths), (1.0, 0.4, -2.0))
    assert figure is not None
    return replace(figure.of(WALK), skeleton=HUMANML3D)  # as a foreign file is read: its lengths are not stated


@pytest.mark.parametrize("factor", [0.7, 1.2])
def test_an_edit_keeps_the_lengths_of_whom_it_is_of(generator: MSCoT, factor: float) -> None:
    theirs, gone = other_person(factor), mask((20, 40))
    result = edited(generator, theirs, gone, "a person walks", samples=2)
    got = result.motion
    torch.testing.assert_close(got.joints[:, ~gone], theirs.joints[~gone].expand(2, -1, -1, -1), atol=1e-5, rtol=0)
    lengths, wanted = bone_lengths(got), bone_lengths(theirs)[0]
    assert float((lengths - wanted).abs().max()) < 1e-4 and result.report["edit"]["kept_moved_m"] < 1e-5
    assert result.report["body"]["height_m"] == pytest.approx(1.7 * factor, abs=0.02)


def test_kept_frames_whose_bones_change_are_made_rigid_and_it_is_said(
    scenectl: Callable[..., Any], generator: MSCoT, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("scenectl.generators.load_generator", lambda *args, **kwargs: generator)
    soft = WALK.joints.clone()
    soft[::2, HUMANML3D.index("left_wrist"), 0] += 0.05
    replace(WALK, joints=soft).save(tmp_path / "motion.npz")
    words = ("edit", tmp_path, "--keep", "0-1.5", "--prompt", "someone sits", "-o", tmp_path / "out", "--no-preview")
    said = scenectl(*words, "--allow-unmet")
    made = Motion.load(tmp_path / "out" / "motion.npz")
    assert float((bone_lengths(made) - rest_lengths(made)).abs().max()) < 1e-4
    moved = float((made.joints[0, :30] - soft[:30]).norm(dim=-1).max())
    assert moved > 0.005 and f"kept frames moved by {1000 * moved:.1f} mm at most" in said.out
    assert "bones of the motion change their lengths" in said.err


def test_each_part_of_an_edit_is_told_what_is_said_of_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    told, make = list[Prompts](), MSCoT.edit

    def watched(self: MSCoT, motion: Motion, regenerate: Tensor, prompts: Prompts | str, **more: Any) -> Draft:
        told.append(Prompts.of(prompts))
        return make(self, motion, regenerate, prompts, **more)

    monkeypatch.setattr(MSCoT, "edit", watched)
    prompts = Prompts((Prompt("walks"), Prompt("turns", 6.0), Prompt("waves", 11.0)))
    long, gone = Motion(walk(260)), mask((30, 50), (230, 250), frames=260)
    edit(MSCoT(bundle()), long, gone, prompts, iterations=0)
    assert [[(p.text, p.begin) for p in one.sentences] for one in told] == [
        [("walks", 0.0), ("turns", 6.0)],
        [("walks", 0.0), ("turns", pytest.approx(2.8)), ("waves", pytest.approx(7.8))],
    ]
    with pytest.raises(UserError, match="begins at 13 s"):
        edit(MSCoT(bundle()), long, gone, Prompts((Prompt("walks"), Prompt("turns", 13.0))))
    result = edited(MSCoT(bundle()), WALK, mask((20, 40)), Prompts((Prompt("walks"), Prompt("turns", 1.0))))
    assert result.report["prompt"] == "0 s: walks; 1 s: turns"
    assert Task(**result.report["task"]).prompts == Prompts((Prompt("walks"), Prompt("turns", 1.0)))
