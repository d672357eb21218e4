"""Parts of a script, and motions that go on: nothing jumps, the best beginnings go on, goals count in their time."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from types import ModuleType

import numpy as np
import pytest
import torch

from scenectl.control import GuidanceSettings, SolverSettings
from scenectl.generators.mscot.sampling import MSCoT
from scenectl.pipeline.going_on import Lead, SeamStep, about, go_on
from scenectl.pipeline.parts import CONTEXT
from scenectl.pipeline.run import LEFT_OUT, run
from scenectl.pipeline.search import Begun, Search, parts_of
from scenectl.tasks.schema import Start
from scenectl.tasks.setup import Setup
from scenectl.tasks.task import Task
from scenes.errors import UserError
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.rigid import rigid
from scenes.motion.skeleton import HUMANML3D
from scenes.world.scene import Scene
from tests.scenectl.small import bundle, walk

FEW = {"iterations": 3, "polish": False, "natural": False, "lead": 0}


@pytest.fixture(scope="module")
def generator() -> MSCoT:
    return MSCoT(bundle())


def built(*tables: dict[str, object], **more: object) -> Setup:
    given: dict[str, object] = {"start": {"position": [0.0, 0.0], "heading": 0.0}, "scene": Scene.empty(), **more}
    return Task(actions=tables, **given).build()  # type: ignore[arg-type]


def test_parts_are_the_acts_and_cover_the_script(generator: MSCoT) -> None:
    setup = built({"do": "stand", "seconds": 1.0}, {"do": "wave"}, {"do": "walk", "to": [0.0, 11.0]}, {"do": "duck"})
    parts, spec = parts_of(setup, generator.spec, generator.spec.shortest_frames), generator.spec
    assert setup.script is not None
    ends = [round(one.end * 20) for one in setup.script.stretches]
    assert parts[0][0] == 0 and parts[-1][1] == ends[-1] and all(a[1] == b[0] for a, b in pairwise(parts))
    assert parts[0][1] == ends[1], "the first act is shorter than any motion, so that the second joins it"
    assert set(ends[1:]) <= {end for _, end in parts}
    assert all(end - first + CONTEXT <= spec.window_frames for first, end in parts)
    assert len(parts) > 3, "the long walk is cut"


def test_what_goes_on_has_no_jump_and_leaves_what_was_before(generator: MSCoT) -> None:
    setup = built({"do": "walk", "to": [0.0, 2.0]})
    turned = Motion(walk(60)).placed(Pose2D((1.0, 0.0, 1.0), 2.0)).joints  # samples go on from motions of their own
    before = Motion(torch.stack([walk(60), turned]), t0=-3.0, skeleton=setup.body.skeleton)
    made = go_on(generator, Lead.of(before, 40), setup.prompts, setup.objective, setup.context,
                 solver=SolverSettings(**FEW)).motion  # fmt: skip
    assert made.joints.shape == (2, 40, 22, 3) and made.t0 == pytest.approx(0.0)
    for old, new in zip(before.joints, made.joints, strict=True):
        whole = torch.cat([old, new])
        rough = (whole[2:] - 2 * whole[1:-1] + whole[:-2]).norm(dim=-1).amax(-1)
        assert rough[57:61].max() <= 1.4 * max(rough[:57].max(), rough[62:].max())  # the latter of random networks
        assert (whole[60] - whole[59]).norm(dim=-1).max() < 0.1


def test_a_step_after_frames_is_linearised_as_it_decodes(generator: MSCoT) -> None:
    before = rigid(Motion(torch.stack([walk(60), 2.0 + walk(60)])), HUMANML3D)
    lead = Lead.of(before, 20)
    draft = generator.edit(lead.whole, lead.unknown, "a person walks", samples=2)
    assert draft.step is not None
    step = SeamStep.of(draft.step, lead.whole, lead.unknown)
    assert torch.allclose(step.motion.joints[:, :40], lead.motion.joints, atol=1e-4)
    tangent, cotangent = torch.randn_like(step.value), torch.randn_like(step.motion.joints)
    there, back = (step.jvp(tangent) * cotangent).sum(), (step.vjp(cotangent) * tangent).sum()
    torch.testing.assert_close(there, back, rtol=1e-3, atol=1e-2)
    rows = step.vjps(torch.stack([cotangent, 2 * cotangent]))
    torch.testing.assert_close(rows[1], 2 * rows[0], rtol=2e-2, atol=1e-2)
    some = torch.tensor([1])
    torch.testing.assert_close(step.take(some).motion.joints, step.motion.joints[some])
    torch.testing.assert_close(step.take(some).vjp(cotangent[some]), step.vjp(cotangent)[some], rtol=1e-3, atol=1e-3)


def test_goals_count_where_they_are_about_some_frame() -> None:
    setup = built({"do": "stand", "seconds": 3.0}, {"do": "turn", "heading": 1.5}, {"do": "duck"})
    assert setup.script is not None
    _, turn, _ = setup.script.stretches
    still = Motion(walk(round((turn.end - turn.begin) * 20) - 2, speed=0.0), t0=turn.begin + 0.05)
    names = {term.name for term in about(setup.objective, setup.context, still).terms}
    assert names == {"2 turn: stays", "2 turn: faces", "sdf_penetration"}
    assert not about(setup.objective, setup.context, still, first=len(still.joints)).terms


def test_beginnings_with_the_fewest_misses_go_on_and_are_made_up_for(generator: MSCoT) -> None:
    setup, walked = built({"do": "stand", "seconds": 2.0}, {"do": "wave"}), Motion(walk(40))
    search = Search(generator, setup, SolverSettings(**FEW), GuidanceSettings(), False, 5, 0, lambda *_: None)
    told = [(1, 0.0), (0, 3.0), (0, 1.0), (0, 2.0), (2, 0.0)]
    begun = [Begun(walked, walked, *worth) for worth in told]
    assert [told.index((one.missed, one.cost)) for one in search._best(begun)] == [2, 3, 1, 2, 3]
    assert {one.cost for one in search._best(begun[:1])} == {0.0}, (
        "who is alone goes on as often as samples are asked for"
    )


def test_a_script_has_as_many_samples_as_asked_for_and_a_seed_decides(generator: MSCoT) -> None:
    task = Task(
        actions=[{"do": "stand", "seconds": 2.0}, {"do": "wave"}, {"do": "duck"}], scene=Scene.empty(), samples=3,
        start={"position": [1.0, 2.0], "heading": 0.5}, solver=FEW,
    )  # fmt: skip
    one, same, other = (run(task, seed=seed, generator=generator) for seed in (1, 1, 2))
    assert one.motion.joints.shape == (3, 160, 22, 3) and torch.isfinite(one.motion.joints).all()
    assert torch.equal(one.motion.joints, same.motion.joints)
    assert not torch.equal(one.motion.joints, other.motion.joints)


def test_then_goes_on_from_the_last_frame(generator: MSCoT) -> None:
    stands = {"do": "stand", "seconds": 2.0}
    first = run(Task(actions=[stands], scene=Scene.empty(), start=[0.0, 0.0], solver=FEW), generator=generator)
    task = Task(prompt="a person walks", seconds=9.0, scene=Scene.empty(), start=[5.0, 5.0], solver=FEW)
    second = first.then(task, generator=generator)
    assert LEFT_OUT in second.report["scene"]["doubts"] and second.motion.joints.shape == (1, 180, 22, 3)
    gap = (second.motion.joints[0, 0] - first.motion.joints[0, -1]).norm(dim=-1).max()
    steps = second.motion.joints[0].diff(dim=0).norm(dim=-1).amax(-1)
    assert gap <= 1.5 * steps.max()
    start = second.report["task"]["start"]
    assert np.allclose(np.array(start["position"])[[0, 2]], first.motion.joint("pelvis")[0, -1, [0, 2]], atol=1e-4)


def test_what_cannot_go_on_is_said(generator: MSCoT, tiny: ModuleType) -> None:
    task = Task(prompt="a person walks", seconds=4.0, scene=Scene.empty(), solver=FEW)
    low = Motion(walk(60) * torch.tensor([1.0, 0.5, 1.0]))
    with pytest.raises(UserError, match="does not end standing"):
        run(task, generator=generator, after=replace(low, skeleton=task.load_body().skeleton))
    with pytest.raises(UserError, match="whose start is free"):
        run(task.model_copy(update={"start": Start(position=(0.0, 0.0), free=True)}), after=low)
    with pytest.raises(UserError, match="times as long as the task's body"):
        child = Task(prompt="x", seconds=4.0, scene=Scene.empty(), body={"height": 1.2})
        run(child, generator=generator, after=Motion(walk(60)))
    with pytest.raises(UserError, match="cannot edit motions"):
        run(task, generator=tiny.TinyGenerator(), after=Motion(walk(60)).placed(Pose2D()))
