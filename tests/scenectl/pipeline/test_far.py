"""Far from the origin: the same task there gives the same motion, goals and figures, whatever it is made of."""

from __future__ import annotations

import json
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch

import scenectl as sc
from objectives import FloorPoint, Point, forget
from scenectl.data.formats.bvh import load_bvh
from scenectl.export.export import export
from scenectl.generators.mscot.sampling import MSCoT
from scenectl.pipeline.editing import edited, mask_of
from scenectl.pipeline.run import run, score
from scenectl.tasks.task import Task
from scenectl.view import of_folder, of_result
from scenes.errors import UserError
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Box, Capsule, Sphere
from scenes.motion.frames import HOME, Place
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.waypoints import Waypoints
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import Scene
from tests.scenectl.small import bundle, walk

FAR = [(500_000.0, 0.0, 4_500_000.0), (0.0, 2_200.0, -7_400.0)]
"""UTM, and a mountain; whole hundreds, so that what is near them is computed as at home."""


def room(o: Place) -> Mesh:
    walls = Box((0.0, 1.25, 0.0), (8.0, 2.5, 8.0)).mesh()
    return Mesh(walls.vertices + o, walls.faces[:, ::-1], "room")


def tasks(o: Place) -> dict[str, dict[str, Any]]:
    """Tasks that lie at `o`: everything that is stated in the world is moved there."""

    def at(x: float, y: float, z: float) -> list[float]:
        return [x + o[0], y + o[1], z + o[2]]

    def on(x: float, z: float) -> list[float]:
        return [x + o[0], z + o[2]]

    ball = Sphere(at(2, 0.3, 1), 0.2, Waypoints([0, 2], [at(2, 0.3, 1), at(1.5, 0.3, 1)]))
    cart = MovingObject(Box((0, 0.4, 0), (0.4, 0.8, 0.4)), Trajectory([0, 2], [at(-2, 0, 1), at(-1, 0, 1)], [0.0, 1.0]))
    mixed = Scene([room(o)], [ball, Capsule(at(2, 0.5, -2), at(2, 1.5, -2), 0.2)], objects=[cart], resolution=48)
    shapes = Scene(primitives=[Box(at(1.5, 1, 2), (0.4, 2, 0.4))], floor=o[1])
    track = {"kind": "waypoints", "times": [0.5, 1.5], "positions": [at(0, 0.9, 0.3), at(0.2, 0.9, 1)]}
    array = {"kind": "array", "positions": [at(0, 0.9, 0.1 * k) for k in range(10)], "fps": 10.0}
    seed = {"free_space": at(0, 1, 0)}
    return {
        "walk in a mesh": {
            "scene": mixed,
            "start": on(0, -1),
            "walk": {"to": on(0.5, 1), "via": [on(-0.3, 0)], "stop": False},
            "goals": [{"use": "sdf_penetration", "margin": 0.03}, {"use": "foot_contact"}],
        },
        "keyframes, a free start": {
            "scene": Scene([room(o)], resolution=48, **seed),
            "start": {"position": at(0, 0, 0), "free": True},
            "goals": [
                {"use": "joint_target", "joint": "right_wrist", "position": at(0.3, 1.2, 1), "sometime": [0.5, 1.9]},
                {"use": "joint_target", "joint": "head", "position": [on(0, 0.2), on(0, 0.7)], "at": [0.5, 1.5]},
                {"use": "head_height", "height": 1.5 + o[1], "at": [1.0]},
            ],
        },
        "tracks and regions": {
            "scene": shapes,
            "start": on(0, 0),
            "goals": [
                {"use": "joint_target", "track": track},
                {"use": "follow_path", "path": [on(0, 0), on(0.2, 1)]},
                {"use": "square_region", "half": 2.0, "center": on(0, 1)},
                {"use": "height_limit", "limit": 1.7 + o[1], "region": {"x": [o[0], 1 + o[0]]}},
                {"use": "barrier", "stand": 1.2 + o[1], "duck": 1.7 + o[1], "feet": 0.3 + o[1]},
                {"use": "capsule_repulsion", "a": at(0.5, 0, 0.5), "b": at(0.5, 1, 0.5), "radius": 0.1},
            ],
        },
        "a bare floor": {
            "scene": {"floor": o[1]},
            "start": on(1, 2),
            "goals": [{"use": "joint_target", "track": array}, {"use": "swept_penetration"}],
        },
        "a sampled start": {"scene": shapes, "start": "sample"},
    }  # fmt: skip


def made(o: Place, name: str, **changes: Any) -> Task:
    return Task(**{"prompt": "slides", "seconds": 2.0, "samples": 2, **tasks(o)[name], **changes})


def close(far: torch.Tensor, home: torch.Tensor, o: Place) -> bool:
    assert far.dtype == torch.float64 and home.dtype == torch.float32
    return bool(((far - torch.tensor(o, dtype=torch.float64)) - home).abs().max() < 1e-4)


@pytest.mark.parametrize("o", FAR)
@pytest.mark.parametrize("name", tasks(HOME))
def test_a_task_far_away_is_the_task_at_home(name: str, o: Place, tiny: ModuleType, tmp_path: Path) -> None:
    here, there = (run(made(place, name), generator=tiny.TinyGenerator()) for place in (HOME, o))
    assert here.setup.origin == HOME and there.setup.origin == o
    assert close(there.motion.joints, here.motion.joints, o)
    again = {place: score(r.motion, made(place, name)) for place, r in ((HOME, here), (o, there))}
    for a, b in ((here, there), (again[HOME], again[o])):
        assert np.allclose(np.subtract(b.report["start"]["position"], o), a.report["start"]["position"], atol=1e-4)
        if a.report["walk"] is not None:
            assert np.allclose(np.subtract(b.report["walk"]["path"], o), a.report["walk"]["path"], atol=1e-4)
        assert b.report["scene"]["floor_m"] - o[1] == pytest.approx(a.report["scene"]["floor_m"], abs=1e-6)
        assert any(str(list(o)) in doubt for doubt in b.report["scene"]["doubts"])
        for one, other in zip(a.samples, b.samples, strict=True):
            assert one.metrics == pytest.approx(other.metrics, abs=1e-4)
            assert one.start and other.start and np.allclose(other.start.position, np.add(one.start.position, o))
            for x, y in zip(one.terms, other.terms, strict=True):
                assert x.met == y.met and x.worst == pytest.approx(y.worst, abs=1e-4)
                assert x.position is None or np.allclose(np.subtract(y.position, o), x.position, atol=1e-4)
    motion = Motion.load(there.save(tmp_path, preview=False) / "motion.npz")
    assert torch.equal(motion.joints, there.motion.joints)


@pytest.mark.parametrize("name", ["walk in a mesh", "tracks and regions", "a bare floor"])
def test_no_place_is_a_bad_one(name: str) -> None:
    """The floor around things without a mesh is a square around the origin of the frame, so that must be near."""
    here = made(HOME, name).build().start.position
    for o in ((512_345.0, 0.0, 4_512_333.0), (-3_050.0, 5_049.0, 1_970.0)):
        setup = made(o, name).build()
        assert np.allclose(np.add(setup.start.position, setup.origin) - o, here, atol=1e-4)
        assert np.abs(setup.start.position).max() < 60


def test_the_report_builds_the_task_again(tiny: ModuleType, tmp_path: Path) -> None:
    name, o = "tracks and regions", FAR[0]
    result = run(made(o, name), 1, generator=tiny.TinyGenerator())
    again = Task(**json.loads(json.dumps(result.report["task"])))
    assert again.terms == made(o, name).terms  # as stated, in the world
    there = score(result.motion, again)
    assert [t.worst for t in there.samples[0].terms] == [t.worst for t in result.samples[0].terms]


def test_pictures_are_drawn_near_the_origin(tiny: ModuleType, tmp_path: Path) -> None:
    for name in ("walk in a mesh", "a bare floor"):
        o = FAR[0]
        result = run(made(o, name), 1, generator=tiny.TinyGenerator())
        pictures = [of_result(result)]
        if name == "a bare floor":  # a mesh from Python is in no file
            pictures.append(of_folder(result.save(tmp_path, preview=False)))
        for picture in pictures:
            assert picture.motion is not None and picture.motion.joints.abs().max() < 20
            assert np.abs(picture.scene.bounds).max() < 50
            places = [p for mark in picture.marks for p in mark.points.reshape(-1, 3).nan_to_num()]
            assert places and torch.stack(places).abs().max() < 50


def test_edits_keep_what_is_kept_and_make_the_same(tmp_path: Path) -> None:
    o, here = FAR[0], Motion(walk(60)).placed(Pose2D((1.0, 0.4, -2.0), 0.8))
    there, generator = here.moved(o), MSCoT(bundle())
    a, b = (edited(generator, m, mask_of(m, [(1.0, 2.0)]), "a person walks", 2) for m in (here, there))
    assert close(b.motion.joints, a.motion.joints, o)
    assert (b.motion.joints[:, :20] - there.joints[:20]).abs().max() < 1e-5
    assert a.samples[0].metrics == pytest.approx(b.samples[0].metrics, abs=1e-4)
    export(there, tmp_path / "there.bvh")
    export(here, tmp_path / "here.bvh")
    assert close(load_bvh(tmp_path / "there.bvh").joints, load_bvh(tmp_path / "here.bvh").joints, o)


def test_check_and_run_tell_of_the_frame_and_a_bake_which_needs_none_does_not(tiny: ModuleType) -> None:
    o = FAR[0]
    here, there = (Scene([room(place)], resolution=32, cache=None) for place in (HOME, o))
    assert here.doubts == there.doubts == ()
    grids = here.bakes[0].grid, there.bakes[0].grid
    places = torch.from_numpy(np.random.default_rng(0).uniform([-3.9, 0.1, -3.9], [3.9, 2.4, 3.9], (500, 3)))
    far = grids[1].distance(places + torch.tensor(o, dtype=torch.float64))
    torch.testing.assert_close(far, grids[0].distance(places), atol=1e-7, rtol=0)
    task = made(o, "walk in a mesh", scene=there)
    (frame,) = task.build().doubts
    assert "frame" in frame and run(task, generator=tiny.TinyGenerator()).report["scene"]["doubts"] == [frame]


def test_errors_say_in_which_frame_places_are() -> None:
    o = FAR[0]
    with pytest.raises(
        UserError, match=r"start \[500001.50, 4500002.00\] is inside .* a frame that begins at \[500000.0,"
    ):
        made(o, "tracks and regions", start=[1.5 + o[0], 2.0 + o[2]]).build()


def test_a_goal_of_ones_own_is_told_the_frame(tiny: ModuleType) -> None:
    seen: list[Place] = []

    @sc.goal(unit="m")
    def stay(motion: Motion, context: Any, *, place: FloorPoint, gate: list[Point], path: Any = None) -> torch.Tensor:
        """Stay there."""
        seen.append(context.origin)
        assert max(abs(number) for number in (*place, *gate[0])) < 50
        world = motion.joint("pelvis")[..., ::2].double() + motion.joints.new_tensor(context.origin)[::2]
        return (world - torch.tensor([500_001.0, 4_500_002.0])).float()

    try:
        o = FAR[0]
        goal = {"use": "stay", "place": [o[0], o[2]], "gate": [[o[0], 0.0, o[2]]], "tolerance": 1.0}
        result = run(made(o, "a bare floor", goals=[goal]), 1, generator=tiny.TinyGenerator())
        assert set(seen) == {o} and result.samples[0].met
    finally:
        forget("stay")


def test_near_the_origin_nothing_is_moved(tiny: ModuleType) -> None:
    for name in tasks(HOME):
        task = made(HOME, name)
        scene = task.load_scene()
        assert task.build(scene=scene).scene is scene and task.seen_from(HOME) is task
