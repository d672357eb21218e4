"""What every generator promises, whatever its family: each registered one on tiny weights, and one without any.

A new family adds its own to `TINY`, and passes.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import pytest
import torch
from torch import Tensor

from objectives import Objective, Term, goals
from scenectl.control import ObjectiveGuide, SolverSettings, refine
from scenectl.generators import registry
from scenectl.generators.base import Draft, Editor, Generator, Step
from scenectl.generators.mscot.sampling import MSCoT
from scenectl.generators.prompts import Prompt, Prompts
from scenectl.pipeline.editing import edit
from scenes.errors import UserError
from scenes.motion.motion import Motion, Pose2D
from tests.objectives.cases import EXAMPLES, context
from tests.scenectl.lively import Lively
from tests.scenectl.small import bundle, walk

TINY: dict[str, Callable[[], Generator]] = {"mscot": lambda: MSCoT(bundle()), "lively": Lively}
WORDS, SECONDS, HERE = "a person walks", 2.0, Pose2D((0.5, 0.0, -1.0), 0.4)


@pytest.fixture(scope="module", params=TINY)
def generator(request: pytest.FixtureRequest) -> Generator:
    return TINY[request.param]()


def drafted(generator: Generator, **changes: object) -> Draft:
    return generator.generate(WORDS, SECONDS, HERE, **{"samples": 2, **changes})  # type: ignore[arg-type]


class Silent:
    """A guide without opinion."""

    def log_prob(self, step: Step) -> Tensor:
        return torch.zeros(len(step.value))

    def gradient(self, step: Step) -> Tensor:
        return torch.zeros_like(step.value)


class Witness(Silent):
    """The same, which keeps what it was shown."""

    def __init__(self) -> None:
        self.steps: list[Step] = []

    def gradient(self, step: Step) -> Tensor:
        self.steps.append(step)
        return super().gradient(step)


def test_every_registered_family_is_tested_here() -> None:
    assert set(registry.MODULES) <= set(TINY)


def test_it_keeps_the_protocol_and_its_spec(generator: Generator) -> None:
    assert isinstance(generator, Generator) and generator.name in TINY and generator.licence
    draft, spec = drafted(generator), generator.spec
    frames = round(SECONDS * spec.fps)
    assert draft.motion.joints.shape == (2, frames, len(spec.skeleton.names), 3)
    assert draft.motion.fps == spec.fps and draft.motion.skeleton == spec.skeleton
    assert draft.motion.joints.isfinite().all() and not draft.motion.joints.requires_grad
    assert ("edit" in spec.abilities) == isinstance(generator, Editor)


def test_a_seed_decides_everything(generator: Generator) -> None:
    torch.manual_seed(1)
    once = drafted(generator, seed=5).motion.joints
    torch.manual_seed(2)  # the global generator has no part in it
    state = torch.get_rng_state()
    again, other = (drafted(generator, seed=seed).motion.joints for seed in (5, 6))
    assert torch.equal(once, again) and torch.equal(torch.get_rng_state(), state)
    assert (once - other).abs().max() > 1e-3 and (once[0] - once[1]).abs().max() > 1e-3


def test_a_guide_without_opinion_is_no_guide(generator: Generator) -> None:
    assert torch.equal(drafted(generator).motion.joints, drafted(generator, guide=Silent()).motion.joints)


def test_samples_of_a_batch_are_those_of_singles(generator: Generator) -> None:
    witness = Witness()
    step = drafted(generator, samples=3, guide=witness).step
    assert step is not None and witness.steps
    goal = Objective((Term("joint_target", {"joint": "head", "position": [0.6, 1.4, -0.5]}, at=1.5),))
    guide = ObjectiveGuide(goal, context())
    few = SolverSettings(iterations=3)  # random networks crumple bodies, whose bones turn far at every rounding
    whole = refine(step, goal, context(), few).motion.joints
    for i in range(3):
        one = step.at(step.value[i : i + 1])
        torch.testing.assert_close(one.motion.joints[0], step.motion.joints[i], atol=1e-4, rtol=1e-4)
        alone = refine(one, goal, context(), few).motion.joints
        torch.testing.assert_close(alone[0], whole[i], atol=5e-3, rtol=0)
    for shown in witness.steps:
        other = shown.value.clone()
        other[1] += 0.1
        before, after = guide.gradient(shown), guide.gradient(shown.at(other))
        torch.testing.assert_close(after[[0, 2]], before[[0, 2]])  # the others know nothing of it


@pytest.mark.parametrize("name", [spec.name for spec in goals()])
def test_every_goal_steers_it(generator: Generator, name: str) -> None:
    given = dict(EXAMPLES[name][0](0.0))
    keys = {key: given.pop(key) for key in ("at", "window", "weights") if key in given}
    term = Term(name, given, tolerance=0.0, **keys)
    goal = Objective((term,))
    for height, share in product((-0.05, 0.05, 0.5), (0.5, 2.0)):  # until something is amiss
        step = generator.generate(WORDS, SECONDS, Pose2D((0.0, height, 0.0)), samples=2).step
        assert step is not None
        noise = torch.randn(step.value.shape, generator=torch.Generator().manual_seed(0))
        step = step.at(step.value + share * step.value.std() * noise)
        before = goal.cost(step.motion, context())
        if (before > 0).any():
            break
    assert (before > 0).any()
    pull = ObjectiveGuide(goal, context()).gradient(step)
    assert pull.isfinite().all() and (pull[before > 0].flatten(1) != 0).any(1).all()
    refined = refine(step, goal, context(), SolverSettings(iterations=40, natural=False, polish=False))
    assert (goal.cost(refined.motion, context()) < before)[before > 0].all()


def test_products_agree_with_each_other_and_with_differences(generator: Generator) -> None:
    witness = Witness()
    draft = drafted(generator, guide=witness)
    assert draft.step is not None
    for step in (*witness.steps, draft.step):
        draw = torch.Generator().manual_seed(0)
        tangent = torch.randn(step.value.shape, generator=draw)
        cotangents = torch.randn(2, *step.motion.joints.shape, generator=draw)
        along = step.jvp(tangent)
        for cotangent in cotangents:
            left, right = (along * cotangent).sum(), (tangent * step.vjp(cotangent)).sum()
            torch.testing.assert_close(left, right, rtol=1e-2, atol=1e-2)
        many = torch.stack([step.vjp(each) for each in cotangents])
        torch.testing.assert_close(step.vjps(cotangents), many, rtol=3e-2, atol=3e-2 * float(many.abs().max()))
        small = 1e-3
        ahead, behind = (step.decode(step.value + sign * small * tangent).joints for sign in (1, -1))
        difference = (ahead - behind) / (2 * small)
        assert (difference - along).norm() <= 0.05 * along.norm() + 1e-3
        assert step.price.product > 0 and step.price.row > 0 and step.unit > 0


def test_a_draft_is_what_its_step_decodes_to(generator: Generator) -> None:
    draft = drafted(generator)
    assert draft.step is not None
    torch.testing.assert_close(draft.step.motion.joints, draft.motion.joints)
    torch.testing.assert_close(draft.step.decode(draft.step.value).joints, draft.motion.joints, atol=1e-5, rtol=0)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"prompts": "  "}, "prompt is empty"),
        ({"prompts": Prompts((Prompt("walks", 0.0, 1.0), Prompt("sits", 1.0, 2.0)))}, "one sentence"),
        ({"prompts": Prompts((Prompt("walks", 0.5),))}, "one sentence"),
        ({"seconds": 0.01}, "lasts from"),
        ({"seconds": 1e4}, "lasts from"),
        ({"seconds": float("nan")}, "nan"),
        ({"start": Pose2D((float("nan"), 0.0, 0.0))}, "finite"),
        ({"start": Pose2D((0.0, 0.0, 0.0), float("inf"))}, "finite"),
        ({"samples": 0}, "at least 1"),
    ],
)
def test_what_is_out_of_range_is_refused_in_a_sentence(
    generator: Generator, wrong: dict[str, object], words: str
) -> None:
    request: dict[str, object] = {"prompts": WORDS, "seconds": SECONDS, "start": HERE}
    if isinstance(wrong.get("prompts"), Prompts) and "sentences" in generator.spec.abilities:
        pytest.skip("it takes several sentences")
    with pytest.raises(UserError, match=words) as error:
        generator.generate(**{**request, **wrong})  # type: ignore[arg-type]
    assert "\n" not in str(error.value)


def test_edits_keep_what_they_promise(generator: Generator) -> None:
    if not isinstance(generator, Editor):
        pytest.skip("it does not edit")
    original = Motion(walk(60), fps=generator.spec.fps)
    gone = torch.zeros(60, dtype=torch.bool)
    gone[20:40] = True
    made = edit(generator, original, gone, WORDS, samples=2, iterations=3).motion.joints
    kept = original.joints[~gone].expand(2, -1, -1, -1)
    torch.testing.assert_close(made[:, ~gone], kept, atol=1e-5, rtol=0)
    assert (made[0] - made[1])[gone].abs().max() > 1e-3
    again = edit(generator, original, gone, WORDS, samples=2, iterations=3).motion.joints
    assert torch.equal(made, again)
    for nothing in (torch.zeros_like(gone), torch.ones_like(gone)):
        with pytest.raises(UserError):
            generator.edit(original, nothing, WORDS)
