"""Steps through a linearised decoder, beside the same steps by autograd; and goals as least squares through them."""

from __future__ import annotations

import torch
from torch import Tensor

from objectives import Objective, Term
from scenectl.control.solvers.problem import Linearisation
from scenectl.control.solvers.residuals import Residuals
from scenectl.generators.base import Step
from scenectl.generators.mscot.keeping import covering
from scenectl.generators.mscot.sampling import MSCoT, Placing, _State
from scenectl.generators.steps import DecodedStep, LatentStep
from scenes.motion.motion import Pose2D
from tests.objectives.cases import context
from tests.scenectl.small import bundle, double

FINEST, SAMPLES = 6, 2
GOALS = Objective(
    (
        Term("joint_target", {"position": [2.0, 0.9, -1.0]}, at=0.9),
        Term("joint_target", {"joint": "right_wrist", "position": [1.5, 1.2, -1.5]}, at=0.5, kernel="huber"),
        Term("follow_path", {"path": [[0.0, 0.0], [0.3, 1.0]]}, weight=0.1),
        Term("smoothness", {}, weight=10.0),
    )
)


def pair() -> tuple[LatentStep, DecodedStep]:
    """The same step, both ways."""
    torch.manual_seed(5)
    generator = MSCoT(double(bundle()))
    quantiser = generator.quantiser
    lengths = list(quantiser.lengths(FINEST))
    value = torch.cat([quantiser.lookup(k, torch.randint(16, (SAMPLES, n))) for k, n in enumerate(lengths)], dim=1)
    state = _State(4 * FINEST - 3, covering(FINEST), Pose2D((1.0, 0.1, -2.0), 0.7), [], [], [])

    def embeddings(v: Tensor) -> list[Tensor]:
        return list(v.split(lengths, dim=1))

    step = generator._step(state, value, lambda v: generator._latent(state, embeddings(v)))
    assert isinstance(step, LatentStep)
    decode = generator.bundle.tokenizer.decode_latent
    return step, DecodedStep(value, lambda v: Placing.of(state)(decode(generator._latent(state, embeddings(v)))))


def test_both_keep_the_protocol_and_decode_alike() -> None:
    fast, plain = pair()
    assert isinstance(fast, Step) and isinstance(plain, Step)
    torch.testing.assert_close(fast.motion.joints, plain.motion.joints)
    torch.testing.assert_close(fast.motion.joints, fast.decode(fast.value).joints)
    assert not fast.motion.joints.requires_grad and not plain.motion.joints.requires_grad


def test_products_are_those_of_autograd_wherever_the_step_is() -> None:
    for fast, plain in (pair(), tuple(s.at(1.1 * s.value) for s in pair())):
        tangent = torch.randn_like(plain.value)
        cotangents = torch.randn(3, *plain.motion.joints.shape, dtype=tangent.dtype)
        torch.testing.assert_close(fast.jvp(tangent), plain.jvp(tangent))
        torch.testing.assert_close(fast.vjps(cotangents), plain.vjps(cotangents))
        torch.testing.assert_close(fast.vjp(cotangents[1]), plain.vjps(cotangents)[1])


def test_rows_of_goals_are_differentiated_through_the_step() -> None:
    fast, plain = pair()
    found = Residuals(GOALS, context(), fast)
    assert isinstance(found, Linearisation)
    value = plain.value.clone().requires_grad_(True)
    rows = torch.cat([b.flatten(1) for b in GOALS.residuals(plain.decode(value), context())], dim=1)
    torch.testing.assert_close(found.rows, rows.detach())
    torch.testing.assert_close(found.cost, GOALS.cost(plain.motion, context()))

    cotangent = torch.randn_like(found.rows)
    (gradient,) = torch.autograd.grad(rows, value, cotangent, retain_graph=True)
    torch.testing.assert_close(found.vjp(cotangent), gradient.flatten(1))

    tangent = torch.randn_like(gradient).flatten(1)
    torch.testing.assert_close((found.jvp(tangent) * cotangent).sum(1), (tangent * gradient.flatten(1)).sum(1))

    some = torch.arange(rows.shape[1]) % 7 == 0
    jacobian = found.jacobian(some)
    torch.testing.assert_close((jacobian @ tangent[..., None]).squeeze(-1), found.jvp(tangent)[:, some])
    assert found.jacobian(torch.zeros_like(some)).shape == (SAMPLES, 0, gradient[0].numel())


def test_the_gradient_of_the_sum_of_squares_is_that_of_the_cost() -> None:
    fast, plain = pair()
    found = Residuals(GOALS, context(), fast)
    value = plain.value.clone().requires_grad_(True)
    (gradient,) = torch.autograd.grad(GOALS.cost(plain.decode(value), context()).sum(), value)
    torch.testing.assert_close(2 * found.vjp(found.rows), gradient.flatten(1))
