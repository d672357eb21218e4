"""Recorded poses and clips: on whose bones, relative to what, when, and what is wrong with them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st
from jaxtyping import Float
from torch import Tensor

from objectives import Clip, Context, Pose, Term
from objectives.library.alignment import _LEAST, _MOST, _squares, _way
from objectives.maths import pelvis_bones
from scenes.errors import UserError
from scenes.mesh.primitives import Cylinder
from scenes.motion.frames import about_y
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.rigid import rigid
from scenes.motion.skeleton import FEET, HUMANML3D, Skeleton
from scenes.world.scene import Scene
from tests.objectives.cases import Joints, context, wandering

angles = st.floats(-math.pi, math.pi)


def person(frames: int = 9, seed: int = 0) -> Motion:
    """Somebody who walks and trembles, on rigid bones."""
    return rigid(wandering(frames=frames, seed=seed))


def moving(seconds: float, fps: float, pace: float = 1.0) -> Motion:
    """Smooth: arms and legs swing, the pelvis goes ahead; at a pace times its usual one."""
    base, times = person(1).joints[0], torch.arange(round(seconds * fps) + 1, dtype=torch.float64) / fps * pace
    swing = torch.sin(times[:, None, None] * torch.linspace(1.0, 3.0, 22, dtype=torch.float64)[:, None] + base)
    ahead = times[:, None, None] * base.new_tensor([0.1, 0.0, 0.9])
    return rigid(Motion(base + 0.2 * swing + ahead, fps=fps))


def worst(term: Term, motion: Motion, where: Context | None = None) -> float:
    found = term.evaluate(motion, context() if where is None else where)
    return float(found.square.sqrt()[found.mask].max())


@given(angles, st.floats(-9, 9), st.floats(-9, 9))
@settings(max_examples=20, deadline=None)
def test_place_and_heading_are_free_relative_to_the_pelvis(turn: float, x: float, z: float) -> None:
    here, wanted = person(3), person(1, seed=3).joints[0]
    term = Term("pose", {"pose": wanted}, at=0.1)
    there = here.placed(Pose2D((x, 0.5, z), turn))
    torch.testing.assert_close(
        term.evaluate(there, context()).square, term.evaluate(here, context()).square, atol=1e-9, rtol=1e-7
    )
    world = Term("pose", {"pose": here.joints[2], "frame": "world"}, at=0.1)
    if abs(x) + abs(z) > 0.01:
        assert worst(world, there) > 0.4


def test_the_tilt_counts() -> None:
    here = person(1)
    over = about_y(0.0)
    lean = torch.tensor([[1, 0, 0], [0, math.cos(0.3), -math.sin(0.3)], [0, math.sin(0.3), math.cos(0.3)]])
    assert np.allclose(over, np.eye(3))
    leaning = replace(here, joints=here.joints @ lean.to(here.joints).T)
    assert worst(Term("pose", {"pose": here.joints[0]}), leaning) > 0.1


@given(st.floats(0.7, 1.3), st.floats(0.7, 1.3))
@settings(max_examples=10, deadline=None)
def test_anybodys_pose_can_be_met_on_ones_own_bones(legs: float, arms: float) -> None:
    """A recording of a person of other proportions, put on the body: met to rounding, and still rigid."""
    factors = [legs if any(w in n for w in ("knee", "ankle", "foot")) else arms for n in HUMANML3D.names]
    other = Skeleton(
        HUMANML3D.names,
        HUMANML3D.parents,
        tuple((x * f, y * f, z * f) for (x, y, z), f in zip(HUMANML3D.offsets, factors, strict=True)),
    )
    recorded = rigid(person(1), other).joints[0]
    for frame in ("pelvis", "world"):
        term = Term("pose", {"pose": recorded, "frame": frame})
        met = term.evaluate(person(1), context())
        if frame == "world":
            assert met.targets is not None
            body = Motion(met.targets.double())
            assert torch.allclose(rigid(body).joints, body.joints, atol=1e-6)
            feet = HUMANML3D.indices(FEET)
            assert body.joints[0, feet, 1].min() == pytest.approx(float(recorded[feet, 1].min()), abs=1e-6)
        else:
            body = rigid(Motion(recorded[None]))
        assert worst(term, body) < 1e-6


def test_several_poses_at_their_times_and_some_joints() -> None:
    here = person(9)
    poses = [here.joints[2].tolist(), here.joints[6].tolist()]
    term = Term("pose", {"pose": poses, "joints": ["head", "left_wrist"], "frame": "world"}, at=[0.1, 0.3])
    found = term.evaluate(here, context())
    assert worst(term, here) < 1e-6 and found.labels == ("head", "left_wrist")
    assert found.mask.any(-1).nonzero()[:, 0].tolist() == [2, 6]
    assert worst(Term("pose", {"pose": poses[0]}, sometime=(0.0, 0.4)), here) < 1e-6  # it finds the moment
    with pytest.raises(UserError, match="2 poses need as many times in 'at', not 1"):
        Term("pose", {"pose": poses}, at=0.1).evaluate(here, context())
    with pytest.raises(UserError, match="goal 'pose': pelvis relative to itself says nothing"):
        Term("pose", {"pose": poses[0], "joints": "pelvis"}).evaluate(here, context())
    with pytest.raises(UserError, match="did you mean 'left_wrist'"):
        Term("pose", {"pose": poses[0], "joints": "left_wrst"}).evaluate(here, context())


@pytest.mark.parametrize("fps", [10.0, 20.0, 30.0])
def test_a_clip_is_followed_on_its_own_clock(fps: float) -> None:
    clip, here = moving(2.0, fps), moving(3.0, 20.0)
    assert worst(Term("like", {"clip": clip, "frame": "world"}), here) < {20.0: 1e-6, 30.0: 2e-3, 10.0: 0.02}[fps]
    late = replace(here, t0=0.5)
    term = Term("like", {"clip": clip, "frame": "world", "begin": 0.5})
    found = term.evaluate(late, context())
    assert found.mask.any(-1).sum() == 41  # after the clip, all is free
    assert worst(term, late) < 0.02
    assert worst(Term("like", {"clip": clip, "frame": "world", "begin": 0.2}), here) > 0.1


@pytest.mark.parametrize("frame", ["pelvis", "world"])
@pytest.mark.parametrize("pace", [0.6, 1.7])
def test_free_timing_keeps_the_order_only(frame: str, pace: float) -> None:
    clip, here = moving(3.0, 20.0), moving(3.0 / pace, 20.0, pace)
    assert worst(Term("like", {"clip": clip, "frame": frame, "timing": "free"}), here) < 0.03
    assert worst(Term("like", {"clip": clip, "frame": frame}), here) > 0.1
    with pytest.raises(UserError, match=r"goes by in 1\.50 to 6\.00 s"):
        Term("like", {"clip": clip, "timing": "free", "end": 1.0}).evaluate(here, context())


@given(st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_no_other_way_through_the_clip_is_nearer(seed: int) -> None:
    draw = torch.Generator().manual_seed(seed)
    steps = torch.randint(_LEAST, _MOST + 1, (6,), generator=draw)
    other = torch.cat([torch.zeros(1, dtype=torch.long), steps.cumsum(0)])
    costs = torch.rand(7, int(other[-1]) + 1, generator=draw, dtype=torch.float64)
    way = _way(costs)
    assert way[0] == 0 and way[-1] == costs.shape[1] - 1
    assert (way.diff() >= _LEAST).all() and (way.diff() <= _MOST).all()
    rows = torch.arange(7)
    assert costs[rows, way].sum() <= costs[rows, other].sum() + 1e-12


@pytest.mark.parametrize("relative", [True, False])
def test_the_alignment_compares_what_the_residual_does(relative: bool) -> None:
    a, b = person(3).joints, person(4, seed=2).joints @ torch.tensor(about_y(0.7)).double().T
    some, frame = [3, 15, 20], "pelvis" if relative else "world"
    squares = _squares(a, b, some, pelvis_bones(HUMANML3D), relative)
    names = [HUMANML3D.names[j] for j in some]
    for t in range(3):
        for n in range(4):
            term = Term("pose", {"pose": _as_recorded(b[n]), "joints": names, "frame": frame})
            found = term.evaluate(Motion(a[t : t + 1]), context())
            assert float(found.square.sum()) == pytest.approx(float(squares[t, n]), abs=1e-6)


def _as_recorded(body: Float[Tensor, "22 3"]) -> Any:
    return body.tolist()


def test_near_things_the_clip_holds_relative_to_the_pelvis() -> None:
    clip = moving(3.0, 20.0)
    x, _, z = clip.joint("pelvis")[30].tolist()
    pillar = Context(Scene(primitives=[Cylinder((x, 1.0, z), 0.1, 2.0)], floor=-2.0), Joints())
    term = Term("like", {"clip": clip, "frame": "world", "clear": 0.5})
    aside = replace(clip, joints=clip.joints + clip.joints.new_tensor([0.4, 0.0, 0.0]))
    found = term.evaluate(aside, pillar)
    assert found.targets is not None
    world = found.targets.isfinite().all(-1).any(-1)
    assert not world[30] and world[0] and world[-1]
    size = found.square.sqrt()
    assert size[~world].max() < 1e-6  # carried along
    assert size[world].min() == pytest.approx(0.4)
    assert worst(term, clip, pillar) < 1e-6
    with pytest.raises(UserError, match="'clear' says something in the world; add frame"):
        Term("like", {"clip": clip, "clear": 0.5}).evaluate(clip, pillar)


@given(angles, st.floats(-5, 5), st.floats(-5, 5))
@settings(max_examples=10, deadline=None)
def test_a_clip_begins_where_and_as_it_is_told(heading: float, x: float, z: float) -> None:
    clip = moving(1.0, 20.0)
    told = {"clip": clip, "frame": "world", "position": [x, z], "heading": heading}
    found = Term("like", told).evaluate(clip, context())
    assert found.targets is not None
    body = Motion(found.targets)
    assert body.joint("pelvis")[0, ::2].tolist() == pytest.approx([x, z])
    again = Term("like", told).evaluate(body.placed(Pose2D((1.0, 0.0, 2.0), 2.0)), context())
    torch.testing.assert_close(again.targets, found.targets)  # of the clip alone
    across = body.joints[0, 1] - body.joints[0, 2]
    assert math.cos(math.atan2(-float(across[2]), float(across[0])) - heading) > 0.9
    assert worst(Term("like", {"clip": clip}), body) < 1e-6


def test_figures_stand_where_the_body_shall_be() -> None:
    here, wanted = person(41), person(1, seed=2).joints[0].tolist()
    marks = Term("pose", {"pose": wanted, "frame": "world"}, at=[0.5, 1.0]).marks(here, context())
    assert len(marks) == 2 * len(HUMANML3D.bones) and {m.shape for m in marks} == {"capsule"}
    marks = Term("pose", {"pose": wanted, "joints": ["left_elbow", "left_wrist", "head"]}, at=0.5).marks(
        here, context()
    )
    assert sorted(m.shape for m in marks) == ["ball", "capsule"]
    (capsule,) = (m for m in marks if m.shape == "capsule")
    assert (capsule.points[0] - here.joints[10, 0]).norm() < 1.2  # carried by the pelvis
    marks = Term("like", {"clip": here}).marks(here, context())
    assert all(m.times is not None and len(m.times) == 41 for m in marks)


@pytest.fixture
def files(tmp_path: Path) -> Path:
    moving(2.0, 30.0).save(tmp_path / "clip.npz")
    (tmp_path / "no.npz").write_bytes(b"PK nothing")
    return tmp_path


@pytest.mark.parametrize("time", [0.0, 0.5, 1.234, 2.0])
def test_a_pose_is_the_clip_at_a_time_of_its_clock(files: Path, time: float) -> None:
    table = {"use": "pose", "pose": f"clip.npz#{time}", "frame": "world", "at": 0.0}
    pose = Term.from_table(table, files).parameters["pose"]
    step = moving(2.0, 600.0).joints[round(time * 600)]
    assert np.abs(pose.joints - step.numpy()).max() < 2e-3
    part = Term.from_table({"use": "like", "clip": f"clip.npz#{time / 2}:{time / 2 + 1}"}, files).parameters["clip"]
    assert part.seconds == pytest.approx(1.0, abs=1 / 30 + 1e-6)
    assert np.abs(part.joints[0] - moving(2.0, 600.0).joints[round(time * 300)].numpy()).max() < 2e-3


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("clip.npz#2.5", r"time 2.5 s lies outside clip '.*clip.npz', which runs from 0 to 2.0\d+ s"),
        ("clip.npz#-1", "time -1 s lies outside"),
        ("clip.npz#nan", "'nan' after '#' is no time"),
        ("clip.npz", r"has 61 frames; say when, such as 'clip.npz#1.5'"),
        ("clip.npz#soon", "'soon' after '#' is no time"),
        ("missing.npz#1", "does not exist"),
        ("no.npz#1", "no.npz"),
        ([[0.0, 0.0, 0.0]] * 21, r"shape \[22, 3\], not \[21, 3\]"),
        ([[0.0, 0.0, math.nan]] * 22, "finite"),
        ({"time": 1.0}, "state either a file or positions"),
        (3, "must be 'FILE#TIME' or a list of 'FILE#TIME', not 3"),
        ({"file": "clip.npz", "time": 1.0, "frame": 3}, "frame"),
    ],
)
def test_what_is_no_pose_is_one_sentence(files: Path, value: Any, said: str) -> None:
    with pytest.raises(UserError, match=said) as caught:
        Term.from_table({"use": "pose", "pose": value, "at": 0.0}, files)
    assert str(caught.value).startswith("goal 'pose': ") and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("clip.npz#1.0", "write '#1.5:4'"),
        ("clip.npz#1.5:0.5", "from a time to a later one, not from 1.5 to 0.5 s"),
        ("clip.npz#1:9", "time 9 s lies outside"),
        (np.zeros((0, 22, 3)), "at least one frame|shape"),
        ({"positions": np.zeros((3, 22, 3)).tolist(), "fps": 0}, "fps"),
    ],
)
def test_what_is_no_clip_is_one_sentence(files: Path, value: Any, said: str) -> None:
    with pytest.raises(UserError, match=said) as caught:
        Term.from_table({"use": "like", "clip": value}, files)
    assert str(caught.value).startswith("goal 'like': ") and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("use", "table", "said"),
    [
        ("pose", {"pose": []}, "'pose' is an empty list"),
        ("like", {"clip": "clip.npz", "frame": "world", "heading": 90}, "in radians, and 90 is more than a turn"),
    ],
)
def test_what_says_nothing_or_degrees_is_one_sentence(files: Path, use: str, table: dict[str, Any], said: str) -> None:
    with pytest.raises(UserError, match=said):
        Term.from_table({"use": use, **table}, files).evaluate(moving(1.0, 20.0), context())


def test_data_of_python_are_taken_as_they_are() -> None:
    clip = moving(1.0, 25.0)
    padded = replace(clip, joints=torch.cat([clip.joints, clip.joints[:3] * torch.nan]), valid=torch.arange(29) < 26)
    assert Clip.model_validate(padded).seconds == pytest.approx(1.0)
    first = Motion(clip.joints[:1])
    for one in (clip.joints[0], clip.joints[0].numpy(), clip.joints[0].tolist(), first):
        for stated in (one, [one]):
            pose = Term("pose", {"pose": stated}).parameters["pose"]
            pose = pose[0] if isinstance(pose, list) else pose
            assert isinstance(pose, Pose) and np.array_equal(pose.joints, clip.joints[0].numpy())
    with pytest.raises(UserError, match="takes one frame, and the motion has 26"):
        Term("pose", {"pose": clip})
