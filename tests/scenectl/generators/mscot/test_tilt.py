"""Token guidance against the exact posterior on a small codebook (Eq. 9 to 11, Proposition 1)."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from scenectl.generators.base import Step
from scenectl.generators.mscot.keeping import covering
from scenectl.generators.mscot.posterior import exact_tilt
from scenectl.generators.mscot.sampling import MSCoT, Placing, _State
from scenectl.generators.mscot.settings import Sampling
from scenectl.generators.steps import DecodedStep
from scenes.motion.motion import Motion, Pose2D
from tests.scenectl.small import bundle, double

FINEST, FRAMES = 6, 24
HERE = Pose2D()


class Goal:
    """log p(G | x) as a function of the decoded joints."""

    def __init__(self, log_prob: Callable[[Tensor], Tensor]) -> None:
        self.function = log_prob

    def log_prob(self, step: Step) -> Tensor:
        return self.function(step.decode(step.value).joints)

    def gradient(self, step: Step) -> Tensor:
        value = step.value.detach().requires_grad_(True)
        return torch.autograd.grad(self.function(step.decode(value).joints).sum(), value)[0]


class LinearStep(DecodedStep):
    """A step of free points, which its decoder alone places: rigid bones are not linear in anything."""

    def decode(self, value: Tensor) -> Motion:
        return self.decoder(value)


class Linear(MSCoT):
    """MSCoT whose decoder is linear: joints are a fixed map of the latent, and on no bones."""

    def __init__(self, shrink: float = 1.0) -> None:
        super().__init__(double(bundle()), Sampling(clip_nats=0.0))
        self.quantiser.gain.mul_(shrink)
        draw = torch.Generator().manual_seed(7)
        self.map = 0.02 * torch.randn(16 * FINEST, FRAMES * 66, generator=draw, dtype=torch.float64)

    def _moved(self, latent: Tensor) -> Motion:
        return Motion((latent.flatten(1) @ self.map).unflatten(1, (FRAMES, 22, 3)))

    def _step(self, state: _State, value: Tensor, latent: Callable[[Tensor], Tensor]) -> Step:
        return LinearStep(value, lambda v: self._moved(latent(v)))


def decoded(generator: MSCoT, state: _State, embeddings: list[Tensor]) -> Motion:
    """Motion of as many scales as there are."""
    latent = generator.quantiser.latent(embeddings, state.finest)
    if isinstance(generator, Linear):
        return generator._moved(latent)
    return Placing.of(state)(generator.bundle.tokenizer.decode_latent(latent))


def situation(generator: MSCoT, k: int, spread: float = 1.0) -> tuple[_State, Tensor, DecodedStep]:
    """Coarser scales drawn at random, and a prior for scale k with its mean."""
    q, draw = generator.quantiser, torch.Generator().manual_seed(k)
    lengths = q.lengths(FINEST)
    drawn = [q.lookup(i, torch.randint(16, (2, n), generator=draw)) for i, n in enumerate(lengths[:k])]
    latent = q.latent(drawn, FINEST) if drawn else None
    state = _State(FRAMES, covering(FINEST), HERE, drawn, drawn, [], latent=latent)
    prior = (spread * torch.randn(2, lengths[k], 16, generator=draw, dtype=torch.float64)).log_softmax(-1)
    mean = prior.exp() @ q.codes(k)
    kind = LinearStep if isinstance(generator, Linear) else DecodedStep
    return state, prior, kind(mean, lambda e: decoded(generator, state, [*drawn, e]))


def exact(generator: MSCoT, prior: Tensor, step: DecodedStep, goal: Goal, k: int) -> Tensor:
    """Eq. 9 by trying every code at every position."""
    codes = generator.quantiser.codes(k)
    rows = [exact_tilt(step, goal, codes, position) for position in range(prior.shape[1])]
    return (prior + torch.stack(rows, dim=1)).log_softmax(-1)


def kl(p: Tensor, q: Tensor) -> Tensor:
    return (p.exp() * (p - q)).sum(-1)


def test_the_exact_posterior_is_bayes_rule_written_out() -> None:
    generator = Linear()
    state, _, step = situation(generator, 2)
    goal = Goal(lambda x: -3 * (x[:, 5, 0, 2] - 1.0).square())
    got, codes = exact_tilt(step, goal, generator.quantiser.codes(2), 1), generator.quantiser.codes(2)
    assert got.shape == (2, 16)
    for sample in range(2):
        for v in (0, 7, 15):
            value = step.value.clone()
            value[sample, 1] = codes[v]
            joints = decoded(generator, state, [*state.refined, value]).joints[sample]
            torch.testing.assert_close(got[sample, v], -3 * (joints[5, 0, 2] - 1.0).square())


@pytest.mark.parametrize("k", [0, 1, 3])
def test_for_a_goal_linear_in_the_motion_first_order_is_exact(k: int) -> None:
    generator = Linear()
    state, prior, step = situation(generator, k)
    weights = torch.randn(FRAMES, 22, 3, dtype=torch.float64)
    goal = Goal(lambda x: (x * weights).sum((1, 2, 3)))
    got = generator._guided(state, prior, k, goal)
    wanted = exact(generator, prior, step, goal, k)
    assert kl(wanted, prior).max() > 0.01  # the goal has something to say
    torch.testing.assert_close(got, wanted, atol=1e-9, rtol=1e-9)
    assert state.moved[0] == pytest.approx(float(kl(wanted, prior).mean()))


def curvature(goal: Goal, step: DecodedStep, position: int, sample: int) -> float:
    """Spectral norm of the Hessian of the log-likelihood in one embedding (constant for a quadratic)."""

    def function(e: Tensor) -> Tensor:
        value = step.value.clone()
        value[sample, position] = e
        return goal.function(step.decode(value).joints)[sample]

    hessian = torch.autograd.functional.hessian(function, step.value[sample, position])
    return float(torch.linalg.matrix_norm(hessian, 2))


@pytest.mark.parametrize("strength", [1.0, 30.0])
@pytest.mark.parametrize("k", [0, 2])
def test_for_a_quadratic_goal_the_divergence_obeys_proposition_1(k: int, strength: float) -> None:
    generator = Linear()
    state, prior, step = situation(generator, k)
    goal = Goal(lambda x: -strength * (x[:, ::4, 0] - 0.5).square().sum((1, 2)))
    approximate = generator._guided(state, prior, k, goal)
    true = exact(generator, prior, step, goal, k)
    divergence = kl(true, approximate)
    codes = generator.quantiser.codes(k)
    for sample in range(2):
        for position in range(prior.shape[1]):
            c = curvature(goal, step, position, sample)
            far = (codes - step.value[sample, position]).square().sum(-1)
            expected = sum((p[sample, position].exp() * far).sum() for p in (true, approximate))
            assert divergence[sample, position] <= c / 2 * expected + 1e-12  # Eq. 32
            assert divergence[sample, position] <= c * far.max() + 1e-12  # Eq. 33
    assert divergence.max() > 1e-6


def test_the_divergence_vanishes_as_codes_shrink() -> None:
    worst = []
    for shrink in (1.0, 0.5, 0.25, 0.125):
        generator = Linear(shrink)
        state, prior, step = situation(generator, 2)
        goal = Goal(lambda x: -30 * (x[:, ::4, 0] - 0.5).square().sum((1, 2)))
        worst.append(float(kl(exact(generator, prior, step, goal, 2), generator._guided(state, prior, 2, goal)).max()))
    # Half the size: a quarter of the bound at the least, and in the end the square of that.
    assert all(b < a / 4 for a, b in zip(worst[:-1], worst[1:], strict=True))


def test_first_order_points_the_right_way_through_the_real_decoder() -> None:
    generator = MSCoT(double(bundle()), Sampling(clip_nats=0.0))
    gained, lost = [], []
    for k in range(4):
        state, prior, step = situation(generator, k)
        goal = Goal(lambda x: -200 * (x[:, -1, 0, [0, 2]] - torch.tensor([0.5, 1.0])).square().sum(1))
        true = exact(generator, prior, step, goal, k)
        gained.append(float(kl(true, prior).mean()))
        lost.append(float(kl(true, generator._guided(state, prior, k, goal)).mean()))
    assert all(after < before for before, after in zip(gained, lost, strict=True))
    # The one token of the first scale moves the whole motion, further than a first order can see.
    assert sum(gained[1:]) > 1e-3 and sum(lost[1:]) < 0.5 * sum(gained[1:])


def test_reported_divergence_is_from_the_prior_a_position() -> None:
    generator = MSCoT(double(bundle()), Sampling(clip_nats=2.0))
    state, prior, _ = situation(generator, 3)
    goal = Goal(lambda x: -50 * (x[:, -1, 0] - 1.0).square().sum(1))
    posterior = generator._guided(state, prior, 3, goal)
    assert state.moved == [pytest.approx(float(kl(posterior, prior).mean()))]
    tilt = posterior - prior
    assert (tilt.amax(-1) - tilt.amin(-1)).max() <= 2.0 + 1e-9
