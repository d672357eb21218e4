"""Goals against the papers' equations, written out as loops over plain numbers."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from objectives import ArrayTrack, Context, Term
from scenes.body.body import DEFAULT_BODY
from scenes.mesh.primitives import Box, Sphere
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D
from scenes.motion.waypoints import Waypoints
from scenes.world.scene import Scene
from tests.objectives.cases import Ball, Joints, context, standing, wandering

J = len(HUMANML3D.names)
HEAD, LEFT, RIGHT = (HUMANML3D.index(name) for name in ("head", "left_foot", "right_foot"))


def relu(u: float) -> float:
    return max(0.0, u)


def rows(motion: Motion) -> list[list[list[float]]]:
    return motion.joints.tolist()


def test_joint_target_is_equation_41() -> None:
    motion, generator = wandering(), torch.Generator().manual_seed(3)
    target = torch.rand(motion.frames, 2, 3, generator=generator, dtype=torch.float64)
    b = torch.rand(motion.frames, 2, generator=generator) < 0.4
    names, sigma = ["left_wrist", "head"], 0.05**2
    expected = 0.0
    for t in range(motion.frames):
        for i, name in enumerate(names):
            if b[t, i]:
                expected += math.dist(rows(motion)[t][HUMANML3D.index(name)], target[t, i].tolist()) ** 2
    track = ArrayTrack(positions=target.numpy(), mask=b.numpy())
    term = Term("joint_target", {"joint": names, "track": track})
    assert float(term.cost(motion, context())) == pytest.approx(expected / (2 * sigma))


def test_sphere_repulsion_is_equations_42_and_43() -> None:
    motion, center, radius, margin = wandering(), (0.1, 1.0, 0.3), 0.3, 0.15
    expected = 0.0
    for frame in rows(motion):
        for point in frame:
            d = math.dist(point, center) - radius
            expected += relu(margin - d) ** 2
    term = Term("sphere_repulsion", {"center": center, "radius": radius, "margin": margin})
    assert float(term.cost(motion, context())) == pytest.approx(expected / (motion.frames * J))


def test_a_moving_sphere_is_where_its_track_is() -> None:
    motion = wandering(t0=1.0)
    track = {"kind": "waypoints", "times": [1.1, 1.3], "positions": [[0, 1, 0], [0.4, 1, 0]]}
    expected = 0.0
    for t, frame in enumerate(rows(motion)):
        share = min(1, max(0, (1.0 + t / 20 - 1.1) / 0.2))
        for point in frame:
            expected += relu(0.1 - (math.dist(point, (0.4 * share, 1, 0)) - 0.3)) ** 2
    term = Term("sphere_repulsion", {"center": track, "radius": 0.3})
    assert float(term.cost(motion, context())) == pytest.approx(expected / (motion.frames * J))


def test_a_capsule_is_the_nearest_of_many_spheres() -> None:
    motion, a, b = wandering(), torch.tensor([0.2, 0.3, 0.2]), torch.tensor([0.1, 1.4, 0.5])
    centers = [torch.lerp(a, b, torch.tensor(s / 400)).tolist() for s in range(401)]
    expected = sum(
        relu(0.1 - (min(math.dist(p, c) for c in centers) - 0.2)) ** 2 for frame in rows(motion) for p in frame
    )
    term = Term("capsule_repulsion", {"a": a.tolist(), "b": b.tolist(), "radius": 0.2})
    assert float(term.cost(motion, context())) == pytest.approx(expected / (motion.frames * J), rel=1e-4)


def test_sdf_penetration_is_equations_45_and_46() -> None:
    world = Context(Ball(drift=0.4), Joints())
    motion = wandering(t0=0.5)
    points, radius = world.body.points(motion)
    expected = 0.0
    for t in range(motion.frames):
        for m in range(points.shape[-2]):
            phi = world.scene.distance(points[t, m], torch.tensor(0.5 + t / 20, dtype=torch.float64))
            expected += relu(-(float(phi) - float(radius[m])))
    term = Term("sdf_penetration")
    assert expected > 0
    assert float(term.cost(motion, world)) == pytest.approx(expected / (motion.frames * J))


def test_exempted_parts_leave_sum_and_mean() -> None:
    motion, world = wandering(), context()
    everything = Term("sdf_penetration").evaluate(motion, world).residual
    hand = [J - 1]
    rest = [m for m in range(J) if m not in hand]
    always = Term("sdf_penetration", {"exempt": "right_wrist"})
    torch.testing.assert_close(always.cost(motion, world), everything[:, rest].mean())
    window = Term("sdf_penetration", {"exempt": "right_wrist", "exempt_windows": [[0.1, 0.2]]})
    counted = torch.ones_like(everything, dtype=torch.bool)
    counted[2:5, hand] = False
    torch.testing.assert_close(window.cost(motion, world), everything[counted].mean())
    whole = Term("sdf_penetration", {"exempt_windows": [[0.1, 0.2]]})
    torch.testing.assert_close(whole.cost(motion, world), everything[[0, 1, 5, 6, 7, 8]].mean())


def test_foot_contact_is_equations_47_and_48() -> None:
    motion, world, tau = wandering(), context(), 0.01
    expected = 0.0
    for t in range(motion.frames):
        time = torch.tensor(t / 20, dtype=torch.float64)
        phi = min(float(world.scene.distance(motion.joints[t, j], time)) for j in (LEFT, RIGHT))
        expected += relu(phi - world.body.sole_offset - tau)
    term = Term("foot_contact", {"threshold": tau})
    assert float(term.cost(motion, world)) == pytest.approx(expected / motion.frames) and expected > 0


def test_head_height_is_hsi_1() -> None:
    motion, h = wandering(frames=8), (1.3, 1.0, 1.5)
    y = [frame[HEAD][1] for frame in rows(motion)]
    expected = 2 * (y[4] - h[1]) ** 2 + (y[0] - h[0]) ** 2 + (y[7] - h[2]) ** 2
    term = Term("head_height", {"height": list(h)})
    assert float(term.cost(motion, context())) == pytest.approx(expected)
    errors = [abs(y[0] - h[0]), abs(y[4] - h[1]), abs(y[7] - h[2])]
    report = term.report(motion, context())[0]
    assert report.worst == pytest.approx(max(errors)) and report.mean == pytest.approx(sum(errors) / 3)


def test_barrier_is_hsi_2() -> None:
    motion = wandering(frames=11)
    y = motion.joints[..., 1]
    head, left, right = y[:, HEAD].tolist(), y[:, LEFT].tolist(), y[:, RIGHT].tolist()
    m, e = 11 // 2, 10
    expected = (relu(1.5 - head[0]) + relu(1.5 - head[e]) + relu(head[m] - 0.5)) / 3 + (
        relu(left[m]) + relu(right[m])
    ) / 2
    assert float(Term("barrier").cost(motion, context())) == pytest.approx(expected)


@pytest.mark.parametrize("include", [False, True])
def test_square_region_is_hsi_3(include: bool) -> None:
    """Cropped to the valid frames, or over the padded ones as ProgMoGen has it."""
    motion = wandering(frames=12)
    motion = replace(motion, joints=motion.joints * 3, valid=torch.arange(12) < 9)
    frames = rows(motion) if include else rows(motion)[:9]
    parts = [0.0] * 4
    for frame in frames:
        for x, _, z in frame:
            for i, u in enumerate((x - 1, -1 - x, z - 1, -1 - z)):
                parts[i] += relu(u) / (len(frames) * J)
    term = Term("square_region", {"include_padding": include})
    assert float(term.cost(motion, context())) == pytest.approx(sum(parts) / 4)


def test_a_beam_is_a_height_limit_over_a_region() -> None:
    motion = wandering()
    term = Term("height_limit", {"limit": 1.3, "joints": "head", "region": {"z": [0.3, 0.5]}})
    found = term.residual(motion, context())[:, 0]
    for (_, y, z), past in zip([frame[HEAD] for frame in rows(motion)], found.tolist(), strict=True):
        assert past == pytest.approx(relu(y - 1.3) if 0.3 <= z <= 0.5 else 0.0)
    assert 0 < int((found > 0).sum()) < motion.frames


def test_foot_skating_reads_the_speed_of_feet_on_the_ground() -> None:
    """A person dragged along at 1.5 m/s skates at 1.5 m/s; lifted by 10 cm, not at all."""
    joints = standing(9) + torch.tensor([0, 0.02, 0], dtype=torch.float64)
    dragged = joints + torch.arange(9)[:, None, None] * torch.tensor([0.045, 0, 0.06])
    motion, world = Motion(dragged), context(x=2.5)
    report = Term("foot_skating", {"allowed": 0.1}).report(motion, world)[0]
    assert report.worst == pytest.approx(1.4) and report.mean == pytest.approx(1.4) and report.active_frames == 8
    landing = dragged.clone()
    landing[:5, :, 1] += 0.1  # in the air up to frame 4: the steps 5-6, 6-7 and 7-8 have both ends on the ground
    report = Term("foot_skating").evaluate(Motion(landing), world)
    assert (report.square[:, 0] > 0).tolist() == [False] * 5 + [True] * 3 + [False]
    lifted = replace(motion, joints=dragged + torch.tensor([0, 0.1, 0]))
    assert float(Term("foot_skating").cost(lifted, world)) == 0


def test_one_foot_at_rest_is_enough_where_not_each_is_asked() -> None:
    """Of two feet that glide over the ground the slower one counts, whichever it is."""
    world, ways = context(x=2.5), ["left_foot", "right_foot"]

    def worst(joints: torch.Tensor, **more: bool) -> float:
        return Term("foot_skating", {"allowed": 0.0, **more}).report(Motion(joints), world)[0].worst

    for slower in (0.0, 0.02):
        for order in (ways, ways[::-1]):
            joints = standing(9) + torch.tensor([0, 0.02, 0], dtype=torch.float64)
            for foot, step in zip(order, (slower, 0.045), strict=True):
                joints[:, HUMANML3D.index(foot), 0] += step * torch.arange(9)
            assert worst(joints, each=False) == pytest.approx(20 * slower, abs=1e-6)
            assert worst(joints) == pytest.approx(0.9)


def test_foot_clearance_reads_how_low_feet_swing() -> None:
    """A left foot that goes at 1.5 m/s from frame 4 on, at 2 cm, shuffles by 3 cm; higher not at all, slower less."""
    world, foot = context(x=2.5), HUMANML3D.index("left_foot")
    joints = standing(9) + torch.tensor([0, 0.04, 0], dtype=torch.float64)
    joints[:, foot] += torch.arange(9).sub(4).clamp_min(0)[:, None] * torch.tensor([0.045, 0, 0.06])

    def cost(joints: torch.Tensor, **parameters: float) -> float:
        return float(Term("foot_clearance", parameters).cost(Motion(joints), world))

    report = Term("foot_clearance").evaluate(Motion(joints), world)
    assert (report.square > 0).tolist() == [[4 <= t < 8, False] for t in range(9)]
    assert Term("foot_clearance").report(Motion(joints), world)[0].worst == pytest.approx(0.03)
    assert cost(joints, speed=1.25) == pytest.approx(cost(joints) / 16) and cost(joints, speed=1.6) == 0
    assert cost(joints[:1]) == 0
    up = torch.tensor([0, 0.03, 0])
    assert cost(joints + up) == pytest.approx(0)
    hops = torch.tensor([0.0, 1.0]).repeat(5)[:9, None, None] * up  # one end of each step is high enough
    assert cost(joints + hops) == pytest.approx(0)
    assert cost(joints - hops) > cost(joints, height=0.04)
    jumping = (
        standing(9) + torch.tensor([0.0, 0.01, 0.0]) + torch.arange(9)[:, None, None] % 2 * torch.tensor([0, 0.1, 0])
    )
    assert cost(jumping) == 0  # up and down is no swing


def test_smoothness_reads_the_acceleration() -> None:
    time = torch.arange(9, dtype=torch.float64)[:, None, None] / 20
    motion = Motion(standing(9) + 0.5 * 12.0 * time**2 * torch.tensor([0.6, 0.0, 0.8]))
    report = Term("smoothness", {"limit": 10.0}).report(motion, context())[0]
    assert report.worst == pytest.approx(2.0) and report.active_frames == 7


def test_resting_feet_touch_the_floor_of_a_real_scene() -> None:
    """A person whose lowest joint is at the sole's offset: contact is met, and no part is deeper than 2 cm."""
    joints = standing(3, dtype=torch.float32) + torch.tensor([0, 0.3 + DEFAULT_BODY.sole_offset, 0])
    motion, world = Motion(joints), Context(Scene.empty(floor=0.3), DEFAULT_BODY)
    contact = Term("foot_contact", {"threshold": 0.001}).report(motion, world)[0]
    assert contact.met and contact.worst == pytest.approx(0, abs=1e-5)
    assert Term("sdf_penetration").report(motion, world)[0].met
    sunk = replace(motion, joints=joints - torch.tensor([0, 0.1, 0]))
    report = Term("sdf_penetration").report(sunk, world)[0]
    assert not report.met and report.where in ("left_foot", "right_foot", "left_ankle", "right_ankle")
    assert report.worst == pytest.approx(0.1, abs=0.02)


def test_walls_and_risers_hold_nobody_who_floats_beside_them() -> None:
    """Feet 5 cm from a wall, a metre up, are a metre up; over the box and the floor they stand."""
    scene = Scene(primitives=[Box((0.0, 1.0, 1.0), (4.0, 2.0, 1.0)), Box((0.0, 0.1, -1.0), (4.0, 0.2, 1.0))], floor=0.0)
    world, term = Context(scene, DEFAULT_BODY), Term("foot_contact", {"threshold": 0.0})
    sole = DEFAULT_BODY.sole_offset
    for z, y, height in ((0.45, 1.0, 1.0), (0.0, 0.0, 0.0), (-0.45, 0.15, 0.15), (-1.0, 0.2, 0.0), (-1.0, 0.25, 0.05)):
        feet = Motion(torch.tensor([0.0, y + sole, z]).expand(2, J, 3).clone())
        assert term.report(feet, world)[0].worst == pytest.approx(height, abs=1e-4), (z, y)


def test_feet_stand_on_what_moves() -> None:
    lift = Sphere((0.0, 0.0, 0.0), 1.0, motion=Waypoints((0.0, 1.0), ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0))))
    world = Context(Scene(primitives=[lift], floor=-2.0), DEFAULT_BODY)
    joints = torch.zeros(20, J, 3)
    joints[..., 1] = 1.0 + DEFAULT_BODY.sole_offset + (torch.arange(20) / 20)[:, None]
    assert Term("foot_contact", {"threshold": 0.0}).report(Motion(joints), world)[0].worst == pytest.approx(0, abs=1e-4)


def test_swept_penetration_sees_a_wall_that_the_frames_miss() -> None:
    """A person is carried through a plate 2 cm thick between two frames: before it, then behind it."""
    lift = torch.tensor([0, 0.3 + DEFAULT_BODY.sole_offset, 0])
    joints = standing(3, dtype=torch.float32) + lift + torch.tensor([[0, 0, 0.0], [0, 0, 0.1], [0, 0, 2.1]])[:, None]
    motion = Motion(joints)
    world = Context(Scene([], [Box((0.0, 1.0, 1.0), (4.0, 4.0, 0.02))], floor=0.0), DEFAULT_BODY)
    assert Term("sdf_penetration").report(motion, world)[0].met
    report = Term("swept_penetration").report(motion, world)[0]
    assert not report.met and report.unit == "cm" and report.when == pytest.approx(0.05)
    # All go through, the thickest deepest: its radius and half the plate.
    thickest = 100 * (max(part.radius for part in (*DEFAULT_BODY.spheres, *DEFAULT_BODY.capsules)) + 0.01)
    assert thickest - 0.5 <= report.worst <= thickest + 1e-3
    assert Term("swept_penetration").report(Motion(joints[:2]), world)[0].met
    assert Term("swept_penetration").cost(Motion(joints[:1]), world) == 0
    # Of a pose that is held both see the same body.
    sunk = Motion(joints[:1].expand(3, -1, -1) - lift - torch.tensor([0, 0.1, 0]))
    swept, framed = (Term(name).report(sunk, world)[0] for name in ("swept_penetration", "sdf_penetration"))
    assert swept.worst == pytest.approx(100 * framed.worst, abs=0.5)


@pytest.mark.parametrize("goal", ["sdf_penetration", "swept_penetration"])
def test_a_margin_is_kept_from_walls_and_not_from_the_floor_one_stands_on(goal: str) -> None:
    lift = torch.tensor([0, 0.3 + DEFAULT_BODY.sole_offset, 0])
    motion = Motion(standing(3, dtype=torch.float32) + lift)
    floor = Context(Scene.empty(floor=0.3), DEFAULT_BODY)
    without, kept = (Term(goal, {"margin": m}).evaluate(motion, floor).residual for m in (0.0, 0.1))
    torch.testing.assert_close(kept, without)
    # One whose front is 5 cm from a wall, far above the ground, is told to keep 10 from it, feet and all.
    points, radius = DEFAULT_BODY.points(motion)
    front = float((points[..., 2] + radius).amax())
    wall = Context(Scene([], [Box((0.0, 1.0, front + 0.15), (4.0, 4.0, 0.2))], floor=-1.0), DEFAULT_BODY)
    report = Term(goal, {"margin": 0.1}).report(motion, wall)[0]
    assert report.worst == pytest.approx(5.0 if report.unit == "cm" else 0.05, rel=0.1)


@pytest.mark.parametrize("goal", ["sdf_penetration", "swept_penetration"])
def test_a_step_may_be_stood_on_as_a_floor_may(goal: str) -> None:
    lift = torch.tensor([0, 0.2 + DEFAULT_BODY.sole_offset, 0])
    motion = Motion(standing(3, dtype=torch.float32) + lift)
    step = Context(Scene(primitives=[Box((0.0, 0.1, 0.0), (2.0, 0.2, 2.0))], floor=0.0), DEFAULT_BODY)
    without, kept = (Term(goal, {"margin": m}).evaluate(motion, step).residual for m in (0.0, 0.1))
    torch.testing.assert_close(kept, without, atol=1e-4, rtol=0)


def test_a_scene_that_does_not_know_its_ground_has_margins_everywhere() -> None:
    joints = standing(3, dtype=torch.float32) + torch.tensor([0, 0.3 + DEFAULT_BODY.sole_offset, 0])

    class Bare:
        bounds = ((-3, 0, -3), (3, 3, 3))

        def distance(self, points: Tensor, time: Tensor | None = None) -> Tensor:
            return points[..., 1] - 0.3

    terms = [Term("sdf_penetration", {"margin": m}) for m in (0.0, 0.1)]
    without, kept = (term.report(Motion(joints), Context(Bare(), DEFAULT_BODY))[0].worst for term in terms)
    assert kept == pytest.approx(without + 0.1, abs=1e-5)
    assert Context(Bare(), DEFAULT_BODY).ground_under(joints) is None
    assert Scene([], floor=0.3).ground == 0.3
    assert Context(Scene([], floor=0.3), DEFAULT_BODY).ground_under(joints).eq(0.3).all()


def test_speed_beyond_a_limit_counts_at_the_frame_that_a_step_begins_with() -> None:
    joints = standing(4)
    joints[2:, 0, 0] += 0.05  # 1 m/s from frame 1 to 2
    joints[2:, 0, 1] += 0.05
    motion = Motion(joints)
    for axes, speed in (("xz", 1.0), ("y", 1.0), ("xyz", 2**0.5), ("z", 0.0)):
        term = Term("speed_limit", {"limit": 0.2, "joints": "pelvis", "axes": axes})
        found = term.evaluate(motion, context())
        expected = [0.0, max(speed - 0.2, 0.0), 0.0, 0.0]
        assert found.square.sqrt()[:, 0].tolist() == pytest.approx(expected, abs=1e-6)
        assert found.mask[:, 0].tolist() == [True, True, True, False]
    assert Term("speed_limit", {"joints": ["head"]}).met(motion, context())


def test_each_foot_on_the_ground_is_more_than_the_lower_one() -> None:
    motion, world = wandering(), context()
    lower = Term("foot_contact", {"threshold": 0.0}).evaluate(motion, world).residual
    each = Term("foot_contact", {"threshold": 0.0, "each": True}).evaluate(motion, world)
    assert each.labels == ("left_foot", "right_foot") and torch.allclose(each.residual.amin(-1, keepdim=True), lower)
    assert (each.residual.amax(-1) > lower[..., 0]).any()
