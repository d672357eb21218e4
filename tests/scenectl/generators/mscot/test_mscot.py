"""Algorithm 3 with tiny random networks: what a generation promises, whatever the weights."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from objectives import Objective, Term
from scenectl.control import ObjectiveGuide, SolverSettings, refine
from scenectl.generators import load_generator
from scenectl.generators.base import Guide, Step
from scenectl.generators.mscot.keeping import covering
from scenectl.generators.mscot.networks.transformer import Cache
from scenectl.generators.mscot.posterior import Scale, clip_at, clipped, tilted
from scenectl.generators.mscot.sampling import MSCoT, _sample, _State, cfg_at
from scenectl.generators.mscot.settings import Sampling
from scenectl.generators.prompts import Prompt, Prompts
from scenectl.networks.text import TimedText
from scenes.errors import UserError
from scenes.motion.motion import Pose2D
from tests.objectives.cases import context
from tests.scenectl.small import SCALES, bundle

HERE = Pose2D((0.0, 0.0, 0.0), 0.0)
THERE = Pose2D((3.0, 0.2, -4.0), 2.1)


@pytest.fixture(scope="module")
def generator() -> MSCoT:
    return MSCoT(bundle())


class Towards:
    """A guide with a constant gradient; remembers what it was shown."""

    def __init__(self, pull: float = 0.0) -> None:
        self.pull, self.shown = pull, list[tuple[int, ...]]()

    def log_prob(self, step: Step) -> Tensor:
        return self.pull * step.value.flatten(1).sum(1)

    def gradient(self, step: Step) -> Tensor:
        self.shown.append(tuple(step.value.shape))
        return torch.full_like(step.value, self.pull)


def test_it_says_what_it_is(generator: MSCoT) -> None:
    assert (generator.name, generator.licence) == ("mscot", "CC0-1.0")
    spec = generator.spec
    assert (spec.fps, spec.shortest, spec.longest, spec.window_frames) == (20.0, 1.8, 120.0, 196)


@pytest.mark.parametrize("frames", [36, 37, 39, 61, 64, 129, 196])
def test_a_motion_has_the_length_that_was_asked_for(generator: MSCoT, frames: int) -> None:
    got = generator.generate("a person walks", frames / 20, HERE)
    assert got.motion.joints.shape == (1, frames, 22, 3)
    assert got.motion.valid.all() and got.motion.fps == 20.0 and torch.isfinite(got.motion.joints).all()
    assert got.trace["frames"] == frames


def test_a_seed_decides_everything(generator: MSCoT) -> None:
    once, again, other = (generator.generate("a person walks", 2.0, HERE, seed=s, samples=3) for s in (5, 5, 6))
    assert torch.equal(once.motion.joints, again.motion.joints)
    assert (once.motion.joints - other.motion.joints).abs().max() > 1e-3
    torch.manual_seed(99)  # the global generator is nobody's business
    state = torch.get_rng_state()
    assert torch.equal(
        generator.generate("a person walks", 2.0, HERE, seed=5, samples=3).motion.joints, once.motion.joints
    )
    assert torch.equal(torch.get_rng_state(), state)


def test_samples_differ_and_prompts_matter(generator: MSCoT) -> None:
    got = generator.generate("a person walks", 2.0, HERE, samples=4).motion.joints
    assert got.shape == (4, 40, 22, 3)
    assert min(float((got[i] - got[j]).abs().max()) for i in range(4) for j in range(i)) > 1e-3
    other = generator.generate("someone sits", 2.0, HERE, samples=4).motion.joints
    assert (got - other).abs().max() > 1e-3
    loud = generator.generate("  A Person WALKS ", 2.0, HERE, samples=4).motion.joints
    assert torch.equal(got, loud)


def test_an_unguided_motion_moves_rigidly_with_its_start(generator: MSCoT) -> None:
    here, there = (generator.generate("a person walks", 2.0, start, samples=2).motion for start in (HERE, THERE))
    torch.testing.assert_close(there.joints, THERE.apply(here.joints), atol=1e-4, rtol=1e-5)
    root = there.joints[:, 0, 0]
    torch.testing.assert_close(root[:, [0, 2]], torch.tensor([[3.0, -4.0]]).expand(2, 2), atol=1e-4, rtol=0)


def test_goals_are_seen_in_the_world_and_reached_there(generator: MSCoT) -> None:
    goals = Objective((Term("joint_target", {"position": [3.5, 1.0, -4.5]}, at=1.5),))
    draft = generator.generate("a person walks", 2.0, THERE, guide=ObjectiveGuide(goals, context()), samples=2)
    assert draft.step is not None
    got = refine(draft.step, goals, context(), SolverSettings(iterations=60, natural=False))
    free = generator.generate("a person walks", 2.0, THERE, samples=2)
    errors = [goals.cost(m, context()) for m in (got.motion, got.unrefined, free.motion)]
    assert (errors[0] < 0.1 * errors[1]).all() and errors[1].mean() < errors[2].mean()
    assert not got.motion.joints.requires_grad


def test_a_guide_is_shown_every_scale_and_a_draft_holds_all_of_them(generator: MSCoT) -> None:
    guide = Towards()
    draft = generator.generate("a person walks", 2.0, HERE, guide=guide, samples=3)
    lengths = generator.quantiser.lengths(10)
    assert guide.shown == [(3, n, 16) for n in lengths]
    assert draft.step is not None and draft.step.value.shape == (3, sum(lengths), 16)


def test_a_guide_without_opinion_changes_nothing(generator: MSCoT) -> None:
    free = generator.generate("a person walks", 2.0, HERE, seed=3)
    got = generator.generate("a person walks", 2.0, HERE, guide=Towards(), seed=3)
    assert torch.equal(got.motion.joints, free.motion.joints)
    assert got.trace["tilt_kl_nats"] == pytest.approx([0.0] * len(SCALES), abs=1e-5)


@pytest.mark.parametrize("pull", [1.0, 1e4, 1e20])
def test_the_tilt_is_clipped_so_that_the_prior_keeps_a_say(pull: float) -> None:
    made = bundle()
    spreads = []
    for nats in (0.5, 4.0):
        generator = MSCoT(made, Sampling(clip_nats=nats))
        got = generator.generate("a person walks", 2.0, HERE, guide=Towards(pull), samples=2)
        kl = got.trace["tilt_kl_nats"]
        most = [float(clip_at(Sampling(clip_nats=nats), k, len(SCALES), 2).mean()) for k in range(len(SCALES))]
        assert len(kl) == len(SCALES)  # type: ignore[arg-type]
        assert all(0 <= value <= limit for value, limit in zip(kl, most, strict=True))  # type: ignore[call-overload]
        spreads.append(sum(kl))  # type: ignore[arg-type]
    assert spreads[0] < spreads[1]


def test_coarse_scales_are_tilted_less_and_the_first_sample_least() -> None:
    sampling = Sampling(clip_nats=8.0, clip_coarsest=0.25)
    most = torch.stack([clip_at(sampling, k, 10, 3) for k in range(10)])
    assert most[0].tolist() == [2.0, 5.0, 8.0] and most[-1].tolist() == [8.0] * 3
    assert (most.diff(dim=0) >= 0).all() and (most.diff(dim=1) >= 0).all()
    assert clip_at(sampling, 0, 10, 1).tolist() == [2.0] and not clip_at(Sampling(clip_nats=0.0), 0, 10, 3).any()
    shown: list[Scale] = []

    def look(scale: Scale, guide: Guide) -> Tensor:
        shown.append(scale)
        return tilted(scale, guide)

    MSCoT(bundle(), sampling, look).generate("a person walks", 2.0, HERE, guide=Towards(1e6), samples=2)
    assert [scale.nats.tolist() for scale in shown] == [
        clip_at(sampling, k, len(SCALES), 2).tolist() for k in range(len(SCALES))
    ]


def test_clipping_keeps_the_order_and_leaves_small_tilts_alone() -> None:
    tilt = torch.randn(5, 7, 16) * torch.logspace(-2, 3, 5)[:, None, None]
    got = clipped(tilt, 8.0)
    spread = got.amax(-1) - got.amin(-1)
    assert (spread <= 8.0 + 1e-4).all()
    small = (tilt.amax(-1) - tilt.amin(-1)) <= 8.0
    assert small.any() and not small.all()
    torch.testing.assert_close(got[small], tilt[small])
    torch.testing.assert_close(spread[~small], torch.full_like(spread[~small], 8.0))
    assert torch.equal(got.argsort(dim=-1, stable=True), tilt.argsort(dim=-1, stable=True))
    assert torch.equal(clipped(tilt, 0.0), tilt) and torch.equal(clipped(torch.zeros(2, 3), 8.0), torch.zeros(2, 3))


def test_tokens_come_from_the_nucleus_with_the_right_shares() -> None:
    p = torch.tensor([0.5, 0.3, 0.15, 0.05])
    draw = torch.Generator().manual_seed(0)
    logits = p.log().expand(1, 20000, 4)
    for top_p, kept in ((1.0, 4), (0.95, 3), (0.8, 2), (0.5, 1), (0.01, 1)):
        share = torch.bincount(_sample(logits, top_p, draw).flatten(), minlength=4) / 20000
        wanted = torch.where(torch.arange(4) < kept, p, 0.0)
        torch.testing.assert_close(share, wanted / wanted.sum(), atol=0.02, rtol=0)


def test_classifier_free_guidance_runs_from_no_text_to_text_and_beyond() -> None:
    made = bundle()
    first: list[Tensor] = []
    for cfg in (0.0, 1.0, 2.0):
        generator = MSCoT(made, Sampling(cfg=cfg, temperature=1.0))
        text = generator._text(Prompts.of("a person walks"), covering(10), 1)
        first.append(generator._prior(_State(40, covering(10), HERE, [], [], []), text, 0, Cache()))
    transformer, q = made.transformer, made.tokenizer.quantiser
    told = transformer.predict(q, TimedText.whole(made.text.encode(["a person walks"])), [], 0, 10)
    none = transformer.without_text(TimedText.whole(made.text.encode(["whatever it is"])), torch.tensor([True]))
    untold = transformer.predict(q, none, [], 0, 10)
    for got, wanted in zip(first, (untold, told, 2 * told - untold), strict=True):
        torch.testing.assert_close(got, wanted.log_softmax(-1), atol=1e-4, rtol=1e-4)


def test_classifier_free_guidance_of_several_sentences_falls_evenly_from_the_coarsest_scale() -> None:
    both, sampling = torch.tensor([True, False]), Sampling(cfg=2.0, cfg_coarsest=2.5)
    weights = torch.stack([cfg_at(sampling, k, 5, both) for k in range(5)])
    torch.testing.assert_close(weights, torch.stack([torch.linspace(5.0, 2.0, 5), torch.full((5,), 2.0)], dim=1))
    assert cfg_at(sampling, 0, 1, both).tolist() == [5.0, 2.0]
    made = bundle()

    def coarsest(prompts: Prompts, **sampling: float) -> Tensor:
        generator = MSCoT(made, Sampling(temperature=1.0, **sampling))
        text = generator._text(prompts, covering(10), 1)
        return generator._prior(_State(40, covering(10), HERE, [], [], []), text, 0, Cache())

    two = Prompts((Prompt("a person walks"), Prompt("a person waves", 1.0)))
    torch.testing.assert_close(coarsest(two, cfg=2.0, cfg_coarsest=1.5), coarsest(two, cfg=3.0, cfg_coarsest=1.0))
    one = Prompts.of("a person walks")
    torch.testing.assert_close(coarsest(one, cfg=2.0, cfg_coarsest=1.5), coarsest(one, cfg=2.0, cfg_coarsest=1.0))
    assert not torch.allclose(coarsest(two, cfg=2.0, cfg_coarsest=1.5), coarsest(two, cfg=2.0, cfg_coarsest=1.0))


def test_a_low_temperature_leaves_no_choice() -> None:
    generator = MSCoT(bundle(), Sampling(temperature=1e-3))
    got = generator.generate("a person walks", 2.0, HERE, samples=3).motion.joints
    torch.testing.assert_close(got[0], got[1], atol=1e-5, rtol=1e-5)


def test_progress_is_told_scale_by_scale(generator: MSCoT) -> None:
    told: list[tuple[str, float]] = []
    generator.generate("a person walks", 2.0, HERE, progress=lambda what, done: told.append((what, done)))
    assert told == [("tokens", k / len(SCALES)) for k in range(len(SCALES))]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"prompts": "  "}, "prompt is empty"),
        ({"seconds": 1.7}, "1.8"),
        ({"seconds": 121.0}, "120"),
        ({"prompts": Prompts((Prompt("a"), Prompt("b", 2.0)))}, "begins at 2 s"),
        ({"seconds": float("nan")}, "nan"),
        ({"samples": 0}, "at least 1"),
    ],
)
def test_requests_that_make_no_sense_are_refused(generator: MSCoT, wrong: dict[str, object], words: str) -> None:
    request: dict[str, object] = {"prompts": "a person walks", "seconds": 2.0, "start": HERE}
    with pytest.raises(UserError, match=words) as error:
        generator.generate(**{**request, **wrong})  # type: ignore[arg-type]
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"name": "mscott"}, "did you mean 'mscot'"),
        ({"weights": "nowhere"}, "no weights 'nowhere'"),
        ({"temprature": 1.0}, "did you mean 'temperature'"),
        ({"top_p": 1.5}, "top_p"),
        ({"cfg": "much"}, "cfg"),
    ],
)
def test_generators_that_cannot_be_loaded_say_why(arguments: dict[str, object], words: str) -> None:
    with pytest.raises(UserError, match=words) as error:
        load_generator(**arguments)  # type: ignore[arg-type]
    assert "\n" not in str(error.value)
