"""USD files: a UsdSkel character that plays a motion, and its room; in metres with y up where nothing else is asked."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom, UsdShade, UsdSkel, Vt

from scenectl.data.formats.people import UNITS
from scenectl.export.animation import Animation
from scenectl.export.mannequin import COLOUR, Mannequin
from scenectl.export.rooms import Thing, flat, things
from scenectl.export.settings import Settings
from scenes.errors import UserError
from scenes.files import atomic_write, writing
from scenes.mesh.colours import linear
from scenes.mesh.scale import TO_Y_UP
from scenes.motion.bones import rest_pose
from scenes.motion.skeleton import Skeleton

SEVERAL = False
"""One motion a file: tools play the SkelAnimation that is bound, and Blender drops all others without a word."""
TAKES = frozenset({"up", "unit", "scene"})


def write(animations: Sequence[Animation], path: Path, settings: Settings) -> None:
    """Write one animation, in text to `.usda`, in binary to `.usd` and `.usdc`.

    Frame k is at time code k. Joints have the names of the preset, with an underscore for each character that USD does
    not allow in names.

    Raises:
        UserError: a path that cannot be written.
    """
    (animation,) = animations
    axes = Axes(settings.up or "y", UNITS[settings.unit or "m"])
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, axes.up.upper())
    UsdGeom.SetStageMetersPerUnit(stage, axes.metres)
    stage.SetTimeCodesPerSecond(animation.fps)
    stage.SetFramesPerSecond(animation.fps)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(animation.frames - 1)
    world = UsdGeom.Xform.Define(stage, "/World").GetPrim()
    stage.SetDefaultPrim(world)
    Usd.ModelAPI(world).SetKind(Kind.Tokens.component)
    look = _look(stage)
    _person(stage, animation, axes, look)
    if settings.scene is not None:
        room = things(settings.scene, settings.t0 + animation.times, animation.joints)
        UsdGeom.Scope.Define(stage, "/World/Room")
        for thing, name in zip(room, identifiers(thing.name for thing in room), strict=True):
            _thing(stage, f"/World/Room/{name}", thing, axes, look)
    _save(stage, path)


@dataclass(frozen=True)
class Axes:
    """Coordinates of a file: which axis is up, and how many metres its unit has."""

    up: str
    metres: float

    def points(self, points: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
        """Where places (m, y up) are in the file."""
        return self.ways(points) / self.metres

    def ways(self, ways: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
        """Directions, and axes of turns, as the file has them."""
        turned: np.ndarray = ways @ TO_Y_UP[self.up]
        return turned

    def turns(self, quaternions: Float[np.ndarray, "*b 4"]) -> Float[np.ndarray, "*b 4"]:
        """Unit quaternions (w, x, y, z) as the file has them, w last as they lie in memory."""
        return np.concatenate([self.ways(quaternions[..., 1:]), quaternions[..., :1]], axis=-1)


def identifiers(names: Iterable[str]) -> list[str]:
    """Names as USD allows them, of letters, digits and underscores, no two the same."""
    found: list[str] = []
    for name in names:
        plain = valid = Tf.MakeValidIdentifier(name)
        number = 1
        while valid in found:
            number += 1
            valid = f"{plain}_{number}"
        found.append(valid)
    return found


def _person(stage: Any, animation: Animation, axes: Axes, look: Any) -> None:
    """A skeleton in its T-pose, the animation that it is bound to, and the mannequin that it moves."""
    root = UsdSkel.Root.Define(stage, "/World/Person")
    skeleton = UsdSkel.Skeleton.Define(stage, root.GetPath().AppendChild("Skeleton"))
    moves = UsdSkel.Animation.Define(stage, root.GetPath().AppendChild("Motion"))
    rest = rest_pose(animation.skeleton).numpy()
    skeleton.CreateJointsAttr(_paths(animation.skeleton))
    skeleton.CreateRestTransformsAttr(_placed(axes.points(np.array(animation.skeleton.offsets))))
    skeleton.CreateBindTransformsAttr(_placed(axes.points(rest)))
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([moves.GetPath()])
    _move(moves, animation, axes)
    skin = Mannequin.of(animation)
    body = _mesh(stage, root.GetPath().AppendChild("Body"), skin.vertices + rest[animation.ours[0]], skin.faces, axes)
    body.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(axes.ways(skin.normals).astype(np.float32)))
    body.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    _colour(body, np.array([COLOUR]), UsdGeom.Tokens.constant, look)
    bound = UsdSkel.BindingAPI.Apply(body.GetPrim())
    bound.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    bound.CreateGeomBindTransformAttr(Gf.Matrix4d(1))
    most = skin.joints.shape[1]
    carriers = Vt.IntArray.FromNumpy(animation.ours[skin.joints].astype(np.int32).reshape(-1))
    bound.CreateJointIndicesPrimvar(constant=False, elementSize=most).Set(carriers)
    shares = Vt.FloatArray.FromNumpy(skin.weights.astype(np.float32).reshape(-1))
    bound.CreateJointWeightsPrimvar(constant=False, elementSize=most).Set(shares)
    UsdGeom.Boundable(root).CreateExtentAttr(body.GetExtentAttr().Get())


def _move(moves: Any, animation: Animation, axes: Axes) -> None:
    """All places and turns of joints against their parents, at every frame."""
    joints = _paths(animation.skeleton)
    moves.CreateJointsAttr(joints)
    moves.CreateScalesAttr(Vt.Vec3hArray(len(joints), Gf.Vec3h(1)))
    places, turns = moves.CreateTranslationsAttr(), moves.CreateRotationsAttr()
    for frame, place in enumerate(axes.points(animation.translations).astype(np.float32)):
        places.Set(Vt.Vec3fArray.FromNumpy(place), frame)
    for frame, turn in enumerate(axes.turns(animation.rotations).astype(np.float32)):
        turns.Set(Vt.QuatfArray.FromNumpy(turn), frame)


def _thing(stage: Any, path: str, thing: Thing, axes: Axes, look: Any) -> None:
    """A piece of the room, with an orientation and a place at every frame where it moves."""
    normals, seen = flat(thing.vertices, thing.faces)
    mesh = _mesh(stage, path, thing.vertices, thing.faces[seen], axes)
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(axes.ways(normals).astype(np.float32)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.uniform)
    _colour(mesh, thing.colours[seen], UsdGeom.Tokens.uniform, look)
    if thing.places is None or thing.turns is None:
        return
    places, turns = mesh.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble), mesh.AddOrientOp()
    for frame, place in enumerate(axes.points(thing.places).tolist()):
        places.Set(Gf.Vec3d(*place), frame)
    for frame, (x, y, z, w) in enumerate(axes.turns(thing.turns).tolist()):
        turns.Set(Gf.Quatf(w, x, y, z), frame)


def _mesh(stage: Any, path: Any, vertices: np.ndarray, faces: np.ndarray, axes: Axes) -> Any:
    """Triangles as they are, and not as a cage of a smooth surface."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    points = Vt.Vec3fArray.FromNumpy(axes.points(vertices).astype(np.float32))
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(faces), 3))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.astype(np.int32).reshape(-1)))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    return mesh


def _look(stage: Any) -> Any:
    """The one material, matt, of the colours that meshes have."""
    look = UsdShade.Material.Define(stage, "/World/Look")
    surface = UsdShade.Shader.Define(stage, "/World/Look/Surface")
    colour = UsdShade.Shader.Define(stage, "/World/Look/Colour")
    colour.CreateIdAttr("UsdPrimvarReader_float3")
    colour.CreateInput("varname", Sdf.ValueTypeNames.String).Set("displayColor")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.9)
    seen = colour.CreateOutput("result", Sdf.ValueTypeNames.Float3)
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(seen)
    look.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    return look


def _colour(mesh: Any, colours: np.ndarray, each: Any, look: Any) -> None:
    """sRGB colours of all of a mesh or of each face, and the material that shows them."""
    shown = Vt.Vec3fArray.FromNumpy(linear(colours).astype(np.float32))
    mesh.CreateDisplayColorPrimvar(each).Set(shown)
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(look)


def _paths(skeleton: Skeleton) -> Vt.TokenArray:
    """Every joint as the way to it from the root."""
    names = identifiers(skeleton.names)
    for parent, joint in skeleton.bones:
        names[joint] = f"{names[parent]}/{names[joint]}"
    return Vt.TokenArray(names)


def _placed(places: Float[np.ndarray, "J 3"]) -> Vt.Matrix4dArray:
    """Places as transforms without a turn."""
    return Vt.Matrix4dArray([Gf.Matrix4d(1).SetTranslate(Gf.Vec3d(*place)) for place in places.tolist()])


def _save(stage: Any, path: Path) -> None:
    """Write a file whole or not at all: USD writes to paths only, whose ending tells it how."""
    with writing(path), tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / f"stage{path.suffix.lower()}"
        try:
            stage.GetRootLayer().Export(str(made))
        except Tf.ErrorException as error:  # a full disk
            raise UserError(f"cannot write '{path}': {str(error).strip().splitlines()[-1]}") from error
        with atomic_write(path) as file:
            file.write(made.read_bytes())
