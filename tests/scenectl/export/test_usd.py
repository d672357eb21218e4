"""USD as UsdSkel's queries, its validators and a look at the text see it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdSkel, UsdValidation, Vt
from scipy.spatial.transform import Rotation

from scenectl.data.formats.people import UNITS
from scenectl.export.animation import Animation
from scenectl.export.export import export
from scenectl.export.mannequin import Mannequin
from scenectl.export.names import PRESETS, named
from scenectl.export.usd import identifiers
from scenes import Box, MovingObject, Scene, Sphere, Trajectory
from scenes.errors import UserError
from scenes.mesh.scale import TO_Y_UP
from scenes.motion.bones import rest_pose
from scenes.motion.motion import Motion
from tests.scenectl.export.moving import lengths, moving

ALL = [(20.0, "y", None), (30.0, "z", "m"), (60.0, "y", "in"), (60.0, "z", "cm")]


def bound(stage: Any) -> tuple[Any, Any]:
    """The skeleton and the mesh bound to it, as UsdSkel finds them."""
    root, cache = UsdSkel.Root(stage.GetPrimAtPath("/World/Person")), UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    (binding,) = cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate)
    (target,) = binding.GetSkinningTargets()
    return cache.GetSkelQuery(binding.GetSkeleton()), target


def world(stage: Any, points: np.ndarray) -> np.ndarray:
    """Points of a file in metres, y up, by what the file says of itself."""
    up, metres = UsdGeom.GetStageUpAxis(stage).lower(), UsdGeom.GetStageMetersPerUnit(stage)
    moved: np.ndarray = points * metres @ TO_Y_UP[up].T
    return moved


def joints(stage: Any, frame: float, at_rest: bool = False) -> np.ndarray:
    places = UsdGeom.XformCache(frame)
    transforms = bound(stage)[0].ComputeJointWorldTransforms(places, at_rest)
    return world(stage, np.array(transforms)[:, 3, :3])


def moved(skin: Mannequin, made: Animation, frame: int) -> np.ndarray:
    """Corners of the mannequin, each where its joints carry it."""
    rest = rest_pose(made.skeleton).numpy()[made.ours]
    found = np.zeros_like(skin.vertices)
    for joint, ours in enumerate(made.ours):
        turn = Rotation.from_quat(made.orientations[frame, ours], scalar_first=True)
        share = np.where(skin.joints == joint, skin.weights, 0.0).sum(axis=1)[:, None]
        found += share * (turn.apply(skin.vertices - (rest[joint] - rest[0])) + made.joints[frame, ours])
    return found


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(("fps", "up", "unit"), ALL)
def test_joints_stand_within_a_millimetre(preset: str, fps: float, up: str, unit: str | None, tmp_path: Path) -> None:
    motion = moving(13, seed=int(fps))
    export(motion, tmp_path / "x.usdc", fps=fps, names=preset, up=up, unit=unit)
    stage = Usd.Stage.Open(str(tmp_path / "x.usdc"))
    made = named(Animation.of(motion)[0].resampled(fps), preset)
    assert UsdGeom.GetStageUpAxis(stage) == up.upper()
    assert UsdGeom.GetStageMetersPerUnit(stage) == UNITS[unit or "m"]
    assert stage.GetTimeCodesPerSecond() == fps and stage.GetFramesPerSecond() == fps
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, made.frames - 1)
    back = np.stack([joints(stage, frame) for frame in range(made.frames)])
    np.testing.assert_allclose(back, made.joints, atol=1e-5)
    stride = round(fps / 20) if fps % 20 == 0 else 3
    original = motion.joints.numpy()[:: round(stride * 20 / fps)]
    np.testing.assert_allclose(back[::stride, made.ours], original[: len(back[::stride])], atol=1e-3)
    if preset in ("humanml", "mixamo", "unity", "vrm"):
        assert np.ptp(lengths(back, made.skeleton.parents), axis=0).max() < 1e-5


@pytest.mark.parametrize("preset", PRESETS)
def test_at_rest_and_bound_the_body_is_the_t_pose(preset: str, tmp_path: Path) -> None:
    export(moving(5), tmp_path / "x.usdc", names=preset, up="z", unit="cm")
    stage = Usd.Stage.Open(str(tmp_path / "x.usdc"))
    skeleton = named(Animation.of(moving(5))[0], preset).skeleton
    rest = rest_pose(skeleton).numpy()
    np.testing.assert_allclose(joints(stage, 0, at_rest=True), rest, atol=1e-6)
    bind = np.array(bound(stage)[0].GetJointWorldBindTransforms())
    np.testing.assert_allclose(world(stage, bind[:, 3, :3]), rest, atol=1e-6)
    assert bound(stage)[0].HasBindPose() and bound(stage)[0].HasRestPose()
    paths = [str(path) for path in bound(stage)[0].GetJointOrder()]
    topology = bound(stage)[0].GetTopology()
    assert [topology.GetParent(joint) for joint in range(len(paths))] == list(skeleton.parents)
    assert [path.split("/")[-1] for path in paths] == [name.replace(":", "_") for name in skeleton.names]


@pytest.mark.parametrize(("preset", "up", "unit"), [("humanml", "y", "m"), ("unreal", "z", "cm")])
def test_the_skin_goes_where_its_joints_carry_it(preset: str, up: str, unit: str, tmp_path: Path) -> None:
    motion = moving(9)
    export(motion, tmp_path / "x.usdc", names=preset, up=up, unit=unit)
    stage = Usd.Stage.Open(str(tmp_path / "x.usdc"))
    skeleton, target = bound(stage)
    made = named(Animation.of(motion)[0], preset)
    skin = Mannequin.of(made)
    for frame in range(made.frames):
        points = Vt.Vec3fArray(UsdGeom.Mesh(target.GetPrim()).GetPointsAttr().Get())
        assert target.ComputeSkinnedPoints(skeleton.ComputeSkinningTransforms(frame), points, frame)
        np.testing.assert_allclose(world(stage, np.array(points)), moved(skin, made, frame), atol=1e-5)
    mesh = UsdGeom.Mesh(target.GetPrim())
    points, faces = np.array(mesh.GetPointsAttr().Get()), np.array(mesh.GetFaceVertexIndicesAttr().Get())
    faces = faces.reshape(-1, 3)
    a, b, c = np.moveaxis(points[faces], 1, 0)
    outwards, normals = np.cross(b - a, c - a), np.array(mesh.GetNormalsAttr().Get())
    assert (a * outwards).sum() > 0  # the volume of a skin that is seen from outside
    assert ((normals[faces[:, 0]] * outwards).sum(axis=1) > 0).mean() > 0.99


def room() -> Scene:
    """A box that stands, one that turns while it goes, and a ball; and a floor."""
    way = Trajectory((0.0, 1.0, 2.0), ((0, 0.5, 0), (1, 0.5, 0), (1, 1, 1)), headings=(0.0, 2.0, 1.0))
    things = [MovingObject(Box((0, 0, 0), (0.2, 0.6, 1.0)), way, name="a door: 1")]
    return Scene(primitives=[Box((3, 1, 0), (1, 2, 1)), Sphere((0, 1, 3), 0.4)], floor=0.0, objects=things)


@pytest.mark.parametrize(("up", "unit"), [("y", "m"), ("z", "cm")])
def test_a_room_moves_with_the_person(up: str, unit: str, tmp_path: Path) -> None:
    motion, scene = moving(25), room()
    export(motion, tmp_path / "x.usdc", scene=scene, up=up, unit=unit, fps=30.0, t0=0.25)
    stage = Usd.Stage.Open(str(tmp_path / "x.usdc"))
    meshes = {prim.GetName(): prim for prim in stage.GetPrimAtPath("/World/Room").GetChildren()}
    assert set(meshes) == {"a_door__1", "box", "sphere", "floor"}
    (thing,) = scene.objects
    points = np.array(UsdGeom.Mesh(meshes["a_door__1"]).GetPointsAttr().Get())
    for frame in range(0, 36, 5):
        frames = UsdGeom.XformCache(frame)
        place = np.array(frames.GetLocalToWorldTransform(meshes["a_door__1"]))
        here = world(stage, points @ place[:3, :3] + place[3, :3])
        np.testing.assert_allclose(here, thing.mesh(0.25 + frame / 30).vertices, atol=1e-5)
    box = world(stage, np.array(UsdGeom.Mesh(meshes["box"]).GetPointsAttr().Get()))
    np.testing.assert_allclose(np.stack([box.min(axis=0), box.max(axis=0)]), [[2.5, 0, -0.5], [3.5, 2, 0.5]], atol=1e-6)


@pytest.mark.parametrize("up", ["y", "z"])
def test_things_are_flat(up: str, tmp_path: Path) -> None:
    """Faces without normals are smooth in Blender: corners of rooms were round."""
    export(moving(2), tmp_path / "x.usdc", scene=room(), up=up)
    stage = Usd.Stage.Open(str(tmp_path / "x.usdc"))
    for prim in stage.GetPrimAtPath("/World/Room").GetChildren():
        mesh = UsdGeom.Mesh(prim)
        points, faces = np.array(mesh.GetPointsAttr().Get()), np.array(mesh.GetFaceVertexIndicesAttr().Get())
        a, b, c = np.moveaxis(points[faces.reshape(-1, 3)], 1, 0)
        normals, across = np.array(mesh.GetNormalsAttr().Get()), np.cross(b - a, c - a)
        assert mesh.GetNormalsInterpolation() == "uniform"
        np.testing.assert_allclose(normals, across / np.linalg.norm(across, axis=1)[:, None], atol=1e-4)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("scene", [None, room()])
def test_the_validators_of_usd_find_nothing(preset: str, scene: Scene | None, tmp_path: Path) -> None:
    export(moving(3), tmp_path / "x.usd", names=preset, scene=scene)
    every = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert any("Skel" in validator.GetMetadata().name for validator in every)
    found = UsdValidation.ValidationContext(every).Validate(Usd.Stage.Open(str(tmp_path / "x.usd")))
    assert not [f"{fault.GetName()}: {fault.GetMessage()}" for fault in found]


def test_text_says_what_tools_look_for(tmp_path: Path) -> None:
    motion = moving(4)
    export(motion, tmp_path / "x.usda", names="mixamo")
    text = (tmp_path / "x.usda").read_text()
    for line in ('upAxis = "Y"', "metersPerUnit = 1", "timeCodesPerSecond = 20", 'defaultPrim = "World"'):
        assert line in text
    assert re.search(r'joints = \["mixamorig_Hips", "mixamorig_Hips/mixamorig_Spine"', text)
    assert "half3[] scales" in text and "float3[] translations" in text and "quatf[] rotations" in text
    w, x, y, z = map(float, re.search(r"rotations.timeSamples = \{\s*0: \[\(([^)]*)\)", text)[1].split(","))  # type: ignore[index]
    np.testing.assert_allclose([w, x, y, z], Animation.of(motion)[0].rotations[0, 0], atol=1e-6)


@pytest.mark.parametrize(("ending", "start"), [("usda", b"#usda"), ("usd", b"PXR-USDC"), ("USDC", b"PXR-USDC")])
def test_endings_tell_text_from_binary(ending: str, start: bytes, tmp_path: Path) -> None:
    export(moving(3), tmp_path / f"x.{ending}")
    assert (tmp_path / f"x.{ending}").read_bytes().startswith(start)
    assert [path.name for path in tmp_path.iterdir()] == [f"x.{ending}"]


def test_several_motions_are_as_many_files(tmp_path: Path) -> None:
    motion = moving(6)
    both = Motion(motion.joints.repeat(2, 1, 1, 1), fps=motion.fps, skeleton=motion.skeleton)
    assert [path.name for path in export(both, tmp_path / "x.usdc").files] == ["x_0.usdc", "x_1.usdc"]


def test_a_file_is_whole_or_as_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "x.usda").write_text("before")

    def full(self: Path) -> bytes:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "read_bytes", full)
    with pytest.raises(UserError, match=r"x\.usda.*No space left"):
        export(moving(3), tmp_path / "x.usda")
    monkeypatch.undo()
    assert (tmp_path / "x.usda").read_text() == "before"
    with pytest.raises(UserError, match="folder"):
        (tmp_path / "y.usd").mkdir()
        export(moving(3), tmp_path / "y.usd")


def test_names_are_valid_and_differ() -> None:
    names = identifiers(["a:b", "a_b", "a b", "a_b_2", "1", "ü"])
    assert len(set(names)) == 6 and all(name.isidentifier() for name in names)
    assert names[0] == "a_b"
