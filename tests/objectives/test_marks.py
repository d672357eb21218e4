"""What there is to see of goals, where they draw joints, and which joints and times they name: told without names."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

import pytest
import torch
from torch import Tensor

from objectives import FloorPoint, Mark, Masked, Objective, Point, Term, Time, Window, diagnosis, forget, goal
from objectives.parameters import stated
from scenes.errors import UserError
from scenes.motion.motion import Motion
from scenes.world.moving import MovingObject
from tests.objectives.cases import EXAMPLES, Ball, context, standing, wandering

Some = pytest.approx


def motion(frames: int = 61) -> Motion:
    """A person who stands at the origin for three seconds."""
    return Motion(standing(frames))


def seen(use: str, parameters: dict[str, Any], **options: Any) -> list[Mark]:
    return Term(use, parameters, **options).marks(motion(), context())


def drawn(use: str, parameters: dict[str, Any], **options: Any) -> tuple[Tensor, Tensor]:
    """Targets ``[T, n, 3]`` and where they hold ``[T, n]``."""
    found = Term(use, parameters, **options).evaluate(motion(), context())
    assert found.targets is not None
    return found.targets, found.mask


def test_places_are_balls_and_places_on_the_floor_rings() -> None:
    (ball,) = seen("joint_target", {"joint": "head", "position": [1.0, 1.5, 2.0]}, at=1.0, tolerance=0.2)
    assert (ball.shape, ball.role, ball.radius, ball.times) == ("ball", "goal", 0.2, None)
    assert ball.points.tolist() == [[1.0, 1.5, 2.0]]
    (ring,) = seen("joint_target", {"position": [1.0, 2.0]}, at=[0.5, 1.5])[:1]
    assert ring.shape == "ring"
    assert ring.points[0, 0] == 1.0 and ring.points[0, 2] == 2.0 and ring.points[0, 1].isnan()  # on the floor
    assert len(seen("joint_target", {"position": [1.0, 1.0, 2.0]})) == 1  # held at every frame, and one ball
    several = {"position": [[0.0, 1.0, 1.0], [0.0, 1.0, 2.0]]}
    assert [mark.points[0, 2].item() for mark in seen("joint_target", several, at=[1.0, 2.0])] == [1.0, 2.0]


def test_what_is_free_is_where_the_joint_is() -> None:
    head = motion().joint("head")[0]
    (ring,) = seen("head_height", {"height": 1.2}, at=1.0)
    assert ring.shape == "ring" and ring.radius > 0.15  # around the head, not in it
    assert ring.points[0].tolist() == Some([float(head[0]), 1.2, float(head[2])])
    assert seen("head_height", {"height": 1.2, "mode": "below"}) == []  # a limit draws nowhere


def test_tracks_are_lines_as_long_as_they_hold() -> None:
    track = {"kind": "line", "start": [0, 1, 0], "end": [2, 1, 0], "times": [0.5, 2.5]}
    (line,) = seen("joint_target", {"track": track}, window=[1.0, 2.0])
    assert line.shape == "line"
    assert (line.points[0, 0].item(), line.points[-1, 0].item()) == Some((0.5, 1.5), abs=1e-6)


def test_obstacles_stand_or_move_with_the_motion() -> None:
    (ball,) = seen("sphere_repulsion", {"center": [1.0, 1.0, 1.0], "radius": 0.3})
    assert (ball.shape, ball.role, ball.radius) == ("ball", "obstacle", 0.3) and (ball.points == 1.0).all()
    way = {"kind": "line", "start": [0, 0, 0], "end": [3, 0, 0], "times": [0.0, 3.0]}
    (capsule,) = seen("capsule_repulsion", {"a": way, "b": [0.0, 1.5, 0.0], "radius": 0.2})
    assert capsule.shape == "capsule" and capsule.points.shape == (61, 2, 3)
    assert capsule.times is not None and capsule.times[20].item() == Some(1.0)
    assert capsule.points[20].tolist() == [Some([1.0, 0.0, 0.0], abs=1e-6), Some([0.0, 1.5, 0.0])]


def test_regions_and_ways_are_outlined() -> None:
    (square,) = seen("square_region", {"half": 0.5, "center": [1.0, 2.0]})
    assert square.points[:, 0].amin() == 0.5 and square.points[:, 2].amax() == 2.5 and square.points[:, 1].isnan().all()
    (beam,) = seen("height_limit", {"limit": 1.3, "region": {"x": [-1, 1], "z": [0, 1]}})
    assert (beam.points[:, 1] == 1.3).all() and beam.role == "obstacle"
    assert seen("height_limit", {"limit": 1.3, "region": {"x": [-1, 1]}}) == []  # it has no end
    path = {"path": [[0, 0], [0, 1], [1, 1]], "begin": 0.0, "end": 2.0}
    (way,) = seen("follow_path", path)
    assert way.role == "way" and way.points[:, ::2].tolist() == path["path"]


def test_aims_are_arrows_from_where_the_joint_is_and_what_they_aim_at_is_seen() -> None:
    pelvis, shoulder = motion().joint("pelvis")[0], motion().joint("right_shoulder")[0]
    arrow, other = seen("face", {"heading": 1.5708}, at=[1.0, 2.0])
    assert (arrow.shape, arrow.role, arrow.times) == ("arrow", "goal", None)
    assert arrow.points[0].tolist() == Some(pelvis.tolist()) and torch.equal(arrow.points, other.points)
    assert (arrow.points[1] - arrow.points[0]).tolist() == Some([0.5, 0.0, 0.0], abs=1e-4)
    ball, *arrows = seen("face", {"position": [0.0, 1.5, 3.0]}, window=[1.0, 2.0])
    assert ball.shape == "ball" and [mark.shape for mark in arrows] == ["arrow"] * 3  # how a span begins, goes on, ends
    assert seen("face", {"position": [0.0, 3.0]}, at=1.0)[0].shape == "ring"
    (up,) = seen("bone_direction", {"bone": ["right_shoulder", "right_wrist"], "direction": [0, 9, 0]}, at=1.0)
    assert (up.points[0] - shoulder).norm() < 1e-6 and (up.points[1] - shoulder).tolist() == Some([0.0, 0.5, 0.0])
    (forearm,) = seen("joint_rotation", {"joint": "left_elbow", "euler": [0, -90, 0]}, at=1.0)
    assert (forearm.points[1] - forearm.points[0]).tolist() == Some([0.0, 0.0, 0.5], abs=1e-6)
    line, *_ = seen("face", {"track": {"kind": "line", "start": [0, 1, 3], "end": [2, 1, 3], "times": [0.5, 2.5]}})
    assert line.shape == "line"


def test_no_mark_asks_for_a_distance() -> None:
    class Deaf:
        bounds = ((-1, 0, -1), (1, 3, 1))

        def distance(self, points: Tensor, time: Tensor | None = None) -> Tensor:
            raise AssertionError("a mesh would be baked")

        def part(self, name: str) -> MovingObject:
            return Ball().part(name)

    blind = type(context())(Deaf(), context().body)
    for name, examples in EXAMPLES.items():
        Term.from_table({"use": name, **examples[0](0.0)}).marks(Motion(standing(9)), blind)


@pytest.mark.parametrize("name", EXAMPLES)
def test_aims_are_unit_and_where_the_residual_vanishes(name: str) -> None:
    """Bones turned to their aims leave nothing of the residual: for every goal that states any."""
    for example in EXAMPLES[name]:
        term, there = Term.from_table({"use": name, **example(0.0)}), wandering()
        aim = (found := term.evaluate(there, context())).aim
        assert aim is None or term.spec.pulls
        if aim is None or aim.kind != "bone":
            continue
        (joint,), joints = found.joints, there.joints.clone()
        if joint is not None and term.parameters.get("frame", "world") == "world":
            here = there.skeleton.index(joint)
            above = there.skeleton.parents[here]
            size = (joints[:, here] - joints[:, above]).norm(dim=-1, keepdim=True)
            joints[:, here] = joints[:, above] + size * aim.values[:, 0]
            assert term.evaluate(Motion(joints), context()).square.max() < 1e-8


@pytest.mark.parametrize("name", EXAMPLES)
def test_targets_are_where_the_residual_vanishes(name: str) -> None:
    """Moving each entry to its target, where it has one, leaves nothing of it: for every goal that states any."""
    for example in EXAMPLES[name]:
        term, there = Term.from_table({"use": name, **example(0.0)}), wandering()
        found = term.evaluate(there, context())
        if found.targets is None:
            relative = "frame" in term.spec.parameters and term.parameters.get("frame", "pelvis") == "pelvis"
            assert not term.spec.draws or relative or name == "head_height" or name == "follow_path"
            continue
        assert found.targets.shape[-2:] == (len(found.sizes), 3)
        joints = there.joints.clone()
        for entry, joint in enumerate(found.joints):
            assert joint is not None
            here, aim = joints[..., there.skeleton.index(joint), :], found.targets[..., entry, :]
            use = found.mask[..., entry, None] & ~aim.isnan()
            here[use] = aim[use]
        moved = term.evaluate(Motion(joints), context())
        aimed = found.mask & ~found.targets.isnan().all(-1)
        assert aimed.any() and moved.square[aimed].max() < 1e-12


def test_targets_follow_schedule_track_and_axes() -> None:
    targets, mask = drawn("follow_path", {"path": [[0, 0], [0, 3]], "begin": 0.0, "end": 3.0})
    assert targets[:, 0].isnan().all()  # the corridor draws nowhere
    assert targets[20, 1, 2].item() == Some(1.0, abs=1e-6) and targets[20, 1, 1].isnan() and mask.all()
    targets, mask = drawn("joint_target", {"position": [1.0, 2.0, 3.0], "axes": "xz"}, at=1.0)
    assert targets[20, 0].nan_to_num(nan=-1.0).tolist() == [1.0, -1.0, 3.0] and mask.sum() == 1


@pytest.fixture
def own() -> Iterator[None]:
    @goal(unit="m", pulls=True, tolerance=0.05)
    def fetched(motion: Motion, context: Any, *, x: float, joint: str = "left_wrist", since: Time = 0.0) -> Masked:
        """Bring a joint to x = `x` m."""
        where = motion.joint(joint)[..., None, :]
        target = where.new_tensor([x, 1.0, 0.0]).expand(where.shape)
        return Masked((where - target).flatten(-2), sizes=3, labels=[joint], points=where, targets=target)

    @goal(unit="m")
    def guarded(
        motion: Motion, context: Any, *, door: Point, mat: FloorPoint | None = None, hours: list[Window] | None = None
    ) -> Tensor:
        """Say nothing but a number."""
        return motion.joints[..., 0, :1] * 0 + door.x

    yield
    forget("fetched")
    forget("guarded")


def test_a_users_goal_is_seen_and_diagnosed(own: None) -> None:
    term = Term("fetched", {"x": 20.0}, at=[0.5, 1.0], window=[0.9, 1.1])
    (ball,) = term.marks(motion(), context())
    assert ball.shape == "ball" and ball.points.tolist() == [[20.0, 1.0, 0.0]]
    said = diagnosis(Objective((term,)), motion(), context())
    assert said is not None and said.startswith("the target (left wrist, 1.00 s) is ") and "out of reach" in said
    marks = Term("guarded", {"door": [1.0, 2.0, 3.0], "mat": [4.0, 5.0]}, tolerance=0.1).marks(motion(), context())
    assert [mark.shape for mark in marks] == ["ball", "ring"]
    assert marks[0].points.tolist() == [[1.0, 2.0, 3.0]] and marks[1].points[0, ::2].tolist() == [4.0, 5.0]


def test_times_of_a_users_goal_are_checked_by_their_type(own: None) -> None:
    Objective((Term("fetched", {"x": 1.0, "since": 2.0}),)).check(context(), seconds=3.0)
    with pytest.raises(UserError, match="time 4 s lies outside the motion"):
        Objective((Term("fetched", {"x": 1.0, "since": 4.0}),)).check(context(), seconds=3.0)
    with pytest.raises(UserError, match=r"window \[4.0, 5.0\] s does not touch"):
        Objective((Term("guarded", {"door": [0, 1, 0], "hours": [[1, 2], [4, 5]]}),)).check(context(), seconds=3.0)


@pytest.mark.parametrize(
    ("hint", "value", "found"),
    [
        (Time | None, 1.0, [1.0]),
        (Time | None, None, []),
        (float | list[Time], [1.0, 2.0], [1.0, 2.0]),
        (Annotated[list[Time] | None, "more"], [3.0], [3.0]),
        (float, 1.0, []),
        (tuple[float, float], (1.0, 2.0), []),
    ],
)
def test_times_are_found_in_any_type(hint: Any, value: Any, found: list[float]) -> None:
    assert stated(hint, value, Time) == found


def test_terms_name_the_joints_that_they_are_about(own: None) -> None:
    assert Term("joint_target", {"joint": ["left_foot", "head"], "position": [0, 1, 0]}).joints == ("left_foot", "head")
    assert Term("joint_target", {"position": [0, 1, 0]}).joints == ("pelvis",)
    assert Term("fetched", {"x": 0.0}).joints == ("left_wrist",)
    assert Term("sdf_penetration", {"exempt": ["left_foot"]}).joints == ()
    found = Term("follow_path", {"path": [[0, 0], [0, 3]], "begin": 0.0, "end": 3.0}).evaluate(motion(), context())
    assert found.labels == ("pelvis (corridor)", "pelvis (schedule)") and found.joints == ("pelvis", "pelvis")
