"""Objectives as a guide: likelihoods, their gradients against finite differences, and refinement."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from objectives import Assessed, Context, Objective, Term
from scenectl.control import GuidanceSettings, ObjectiveGuide, Refined, SolverSettings, refine
from scenectl.generators.base import Guide, Step
from scenectl.generators.mscot.keeping import covering
from scenectl.generators.mscot.sampling import MSCoT, Placing, _State
from scenectl.generators.steps import DecodedStep
from scenes.body.body import DEFAULT_BODY
from scenes.mesh.primitives import Box
from scenes.motion.motion import Motion, Pose2D
from scenes.world.scene import Scene
from tests.objectives.cases import context
from tests.scenectl.small import bundle, double, walk
from tests.scenectl.tiny import TinyStep, statue

START = Pose2D((1.0, 0.1, -2.0), 0.7)
GOALS = Objective(
    (
        Term("joint_target", {"position": [2.0, 0.9, -1.0]}, at=1.0),
        Term("joint_target", {"joint": "right_wrist", "position": [1.5, 1.2, -1.5]}, at=0.5, weight=0.1),
    )
)


def step(samples: int = 2, finest: int = 6, exact: bool = False) -> DecodedStep:
    """The latent of random codes at all scales, decoded by random networks."""
    made = double(bundle()) if exact else bundle()
    q = made.tokenizer.quantiser
    generator, decode = MSCoT(made), made.tokenizer.decode_latent
    lengths = q.lengths(finest)
    codes = [q.lookup(k, torch.randint(16, (samples, n))) for k, n in enumerate(lengths)]
    state = _State(4 * finest - 2, covering(finest), START, [], [], [])

    def decoder(value: Tensor) -> Motion:
        return Placing.of(state)(decode(generator._latent(state, list(value.split(list(lengths), dim=1)))))

    return DecodedStep(torch.cat(codes, dim=1), decoder)


def guide(scale: float = 1.0) -> ObjectiveGuide:
    return ObjectiveGuide(GOALS, context(), GuidanceSettings(scale=scale))


def refined(at: Step, **settings: object) -> Refined:
    """Goals alone: random networks have no body to keep."""
    return refine(at, GOALS, context(), SolverSettings.model_validate({"natural": False, "polish": False, **settings}))


def test_the_protocols_are_met() -> None:
    assert isinstance(step(), Step) and isinstance(guide(), Guide)


@pytest.mark.parametrize("scale", [0.0, 1.0, 2.5])
def test_log_likelihood_is_minus_the_cost(scale: float) -> None:
    s = step()
    wanted = -scale * GOALS.cost(s.decode(s.value), context())
    torch.testing.assert_close(guide(scale=scale).log_prob(s), wanted)
    assert wanted.shape == (2,)


def test_the_gradient_is_that_of_finite_differences() -> None:
    s = step(exact=True)
    g = guide(scale=1.5)
    gradient = g.gradient(s)
    assert gradient.shape == s.value.shape and not gradient.requires_grad
    for _ in range(5):
        direction = torch.randn_like(s.value)
        h = 1e-6
        ahead, behind = (g.log_prob(DecodedStep(s.value + sign * h * direction, s.decoder)) for sign in (1, -1))
        numeric = (ahead - behind) / (2 * h)
        torch.testing.assert_close((gradient * direction).flatten(1).sum(1), numeric, rtol=1e-4, atol=1e-4)


def test_samples_do_not_influence_one_another() -> None:
    s = step()
    both = guide().gradient(s)
    for i in range(2):
        torch.testing.assert_close(
            both[i : i + 1], guide().gradient(DecodedStep(s.value[i : i + 1], s.decoder)), rtol=1e-4, atol=1e-4
        )


def test_frames_that_are_not_numbers_do_not_silence_guidance() -> None:
    """Neither whole frames nor single coordinates, which rigid bones mix with all others of their frame."""

    def decoder(value: Tensor) -> Motion:
        joints = walk(40) + value[:, None, None, :3]
        return Motion(joints)

    class Broken(Objective):
        def cost(self, motion: Motion, at: object) -> Tensor:
            bad = motion.joints.new_tensor(-1.0).sqrt()
            frame, rest = motion.joints[:, 3], motion.joints[:, 4:]
            return frame.sum((1, 2)) * bad + rest[..., 0].sum((1, 2)) * bad + rest[..., 1].sum((1, 2))

    g = ObjectiveGuide(Broken(), context())
    gradient = g.gradient(DecodedStep(torch.zeros(1, 3), decoder))
    assert torch.isfinite(gradient).all() and gradient[0, 1] != 0


@pytest.mark.parametrize("name", ["lbfgs", "adam", "gradient", "lm", "gauss_newton"])
def test_refinement_lowers_the_cost_on_random_networks(name: str) -> None:
    s = step()
    fine = 3e-3 if name == "gradient" else None
    got = refined(s, name=name, iterations=25, step=fine, prior=0.0)
    before, after = (GOALS.cost(motion, context()) for motion in (got.unrefined, got.motion))
    assert torch.equal(got.unrefined.joints, s.motion.joints) and not got.motion.joints.requires_grad
    assert (after < 0.95 * before).all()
    assert got.solution is not None and got.solution.solver == name
    torch.testing.assert_close(got.solution.cost, after, rtol=1e-4, atol=1e-4)


def test_refinement_stops_where_the_goals_are_met() -> None:
    got = refined(step(samples=1), iterations=400, patience=400, prior=0.0)
    assert bool(GOALS.met(got.motion, context()).all())
    assert got.solution is not None and len(got.solution.history) < 200


def test_the_prior_keeps_the_value_near_what_was_generated() -> None:
    s = step()
    moved = []
    for prior in (0.0, 1.0, 1e4):
        solution = refined(s, iterations=6, prior=prior).solution
        assert solution is not None
        moved.append((solution.value - s.value.flatten(1)).norm())
    assert moved[2] < moved[1] < moved[0]


def test_the_prior_counts_distances_in_the_steps_unit() -> None:
    s = step()
    for name in ("lbfgs", "lm"):
        wide, narrow = (
            refined(replace(s, unit=unit), iterations=6, name=name, prior=prior).solution
            for unit, prior in ((10.0, 100.0), (1.0, 1.0))
        )
        assert wide is not None and narrow is not None
        torch.testing.assert_close(wide.value, narrow.value)


def test_no_iterations_mean_no_refinement() -> None:
    s = step()
    got = refined(s, iterations=0)
    assert torch.equal(got.motion.joints, s.motion.joints) and got.solution is None


def test_progress_is_told_and_never_exceeds_one() -> None:
    told: list[tuple[str, float]] = []
    refine(step(), GOALS, context(), SolverSettings(iterations=10), progress=lambda *what: told.append(what))
    fractions = [fraction for _, fraction in told]
    assert {what for what, _ in told} == {"refinement"}
    assert fractions == sorted(fractions) and fractions[0] > 0 and fractions[-1] <= 1.0


def test_forward_and_backward_products_of_a_step_are_adjoint() -> None:
    s = step(exact=True)
    tangent = torch.randn_like(s.value)
    forward = s.jvp(tangent)
    cotangent = torch.randn_like(forward)
    backward = s.vjp(cotangent)
    assert forward.shape == (2, 22, 22, 3) and backward.shape == s.value.shape
    torch.testing.assert_close((forward * cotangent).sum(), (tangent * backward).sum())
    h = 1e-6
    numeric = (s.decode(s.value + h * tangent).joints - s.decode(s.value - h * tangent).joints) / (2 * h)
    torch.testing.assert_close(forward, numeric, rtol=1e-4, atol=1e-6)


def test_the_gradient_of_the_goals_is_the_backward_product_of_their_gradient_in_the_joints() -> None:
    s = step(exact=True)
    motion = s.decode(s.value)
    joints = motion.joints.detach().requires_grad_(True)
    (cotangent,) = torch.autograd.grad(GOALS.cost(Motion(joints, motion.valid), context()).sum(), joints)
    torch.testing.assert_close(guide().gradient(s), -s.vjp(cotangent))


@pytest.mark.parametrize("name", ["lbfgs", "adam", "gradient", "lm", "gauss_newton"])
def test_every_solver_leaves_a_baked_pillar(name: str) -> None:
    """A mesh's grid has first derivatives only, which must do for products with its Jacobian too."""
    pillar = Box((0.0, 1.0, 0.8), (0.4, 2.0, 0.4)).mesh()
    at = Context(Scene([pillar], resolution=24, free_space="outside", cache=None), DEFAULT_BODY)
    standing = TinyStep(torch.tensor([[0.0, 0.6]]).repeat(1, 20, 1), Pose2D())
    goals = Objective(
        (
            Term("joint_target", {"position": [0.0, -0.3]}, tolerance=0.1),
            Term("sdf_penetration", kernel="squared", reduction="sum", weight=10.0),
        )
    )
    step = {"adam": 0.05, "gradient": 1e-3}.get(name)
    solver = SolverSettings(name=name, step=step, natural=False, polish=False, iterations=300)  # type: ignore[arg-type]
    assert goals.met(refine(standing, goals, at, solver).motion, at).all()


@pytest.mark.parametrize("lead", [0, 3])
def test_goals_that_lead_take_a_body_past_a_wall(lead: int) -> None:
    """Inside a slab, on the wrong side of its middle: wall and target balance, unless the target leads first."""
    wall = Scene(primitives=[Box((0.0, 1.0, 0.0), (3.0, 2.0, 1.0))])
    standing = TinyStep(torch.tensor([[0.0, 0.2]]).repeat(1, 30, 1), Pose2D())
    goals = Objective(
        (
            Term("joint_target", {"position": [0.0, float(statue()[0, 1]), -1.2]}, tolerance=0.05),
            Term("sdf_penetration", kernel="squared", reduction="sum", weight=1e3, tolerance=0.03),
        )
    )
    solver = SolverSettings(natural=False, polish=False, lead=lead)
    after = refine(standing, goals, Context(wall, DEFAULT_BODY), solver).motion
    assert bool(goals.met(after, Context(wall, DEFAULT_BODY))) == (lead > 0)


def test_leading_past_a_wall_that_makes_no_sense_there_is_given_up() -> None:
    """Where a goal is not a number wherever the others lead, refinement sets out from the generator's own value."""

    class Cliff(Objective):
        def judge(self, motion: Motion, at: Context) -> tuple[Tensor, Tensor]:
            z, (cost, met) = motion.joints[:, :, 0, 2].mean(1), super().judge(motion, at)
            return cost + torch.where(z < -0.5, torch.nan * z, (z - 0.1).square()), met

        def assess(self, motion: Motion, at: Context) -> Assessed:
            return Assessed([motion.joints[:, :1, 0, :1]], self.cost(motion, at), self.met(motion, at))

    terms = (Term("joint_target", {"position": [0.0, 0.87, -1.2]}, tolerance=0.05), Term("smoothness"))
    standing = TinyStep(torch.tensor([[0.0, 0.2]]).repeat(1, 30, 1), Pose2D())
    goals = Cliff(terms)
    after = refine(standing, goals, context(), SolverSettings(natural=False, polish=False, name="lbfgs")).motion
    assert float(goals.cost(after, context())) <= float(goals.cost(standing.motion, context()))
