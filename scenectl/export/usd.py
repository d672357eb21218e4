"""USD files: a UsdSkel character that plays a motion, in metres with y up unless other axes and units are asked for."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdSkel, Vt

from scenectl.data.formats.people import UNITS
from scenectl.export.animation import Animation
from scenectl.export.settings import Settings
from scenes.errors import UserError, did_you_mean
from scenes.files import atomic_write
from scenes.mesh.scale import TO_Y_UP
from scenes.motion.skeleton import Skeleton

SEVERAL = False
"""One motion a file: tools play the SkelAnimation that is bound, and Blender drops all others without a word."""
TAKES = frozenset({"up", "unit", "scene", "t0"})


def write(animations: Sequence[Animation], path: Path, settings: Settings) -> None:
    """Write one animation: text for `.usda`, binary for `.usd` and `.usdc`.

    Raises:
        UserError: an up axis that USD lacks, an unknown unit, or a path that cannot be written.
    """
    (animation,) = animations
    axes = Axes.asked(settings)
    stage = Usd.Stage.CreateInMemory()
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    UsdGeom.SetStageUpAxis(stage, axes.up.upper())
    UsdGeom.SetStageMetersPerUnit(stage, axes.metres)
    stage.SetTimeCodesPerSecond(animation.fps)
    stage.SetFramesPerSecond(animation.fps)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(animation.frames - 1)
    _person(stage, animation, axes)
    _save(stage, path)


@dataclass(frozen=True)
class Axes:
    """Coordinates of a file: which axis is up, "y" or "z", and how many metres its unit has."""

    up: str
    metres: float

    @classmethod
    def asked(cls, settings: Settings) -> Axes:
        up, unit = settings.up or "y", settings.unit or "m"
        if up not in ("y", "z"):
            raise UserError(f"USD has y or z up, not '{up}'; state one of them")
        if unit not in UNITS:
            raise UserError(f"unknown unit '{unit}'{did_you_mean(unit, UNITS)}")
        return cls(up, UNITS[unit])

    def points(self, points: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
        """Where places (m, y up) are in the file."""
        moved: np.ndarray = self.ways(points) / self.metres
        return moved

    def ways(self, ways: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
        """Directions, and axes of turns, as the file has them."""
        turned: np.ndarray = np.asarray(ways) @ TO_Y_UP[self.up]
        return turned

    def turns(self, quaternions: Float[np.ndarray, "*b 4"]) -> Float[np.ndarray, "*b 4"]:
        """Unit quaternions (w, x, y, z) of the same turns."""
        return np.concatenate([quaternions[..., :1], self.ways(quaternions[..., 1:])], axis=-1)


def identifiers(names: Iterable[str]) -> list[str]:
    """Names as USD allows them, of letters, digits and underscores, no two the same."""
    found: list[str] = []
    for name in names:
        plain = valid = Tf.MakeValidIdentifier(name)
        number = 1
        while valid in found:
            number, valid = number + 1, f"{plain}_{number + 1}"
        found.append(valid)
    return found


def _person(stage: Any, animation: Animation, axes: Axes) -> None:
    """A skeleton standing in its T-pose, the animation that it is bound to, and the mesh that it moves."""
    root = UsdSkel.Root.Define(stage, "/World/Person")
    skeleton = UsdSkel.Skeleton.Define(stage, root.GetPath().AppendChild("Skeleton"))
    moves = UsdSkel.Animation.Define(stage, root.GetPath().AppendChild("Motion"))
    joints = _paths(animation.skeleton)
    local = axes.points(np.array(animation.skeleton.offsets, np.float64))
    skeleton.CreateJointsAttr(joints)
    skeleton.CreateRestTransformsAttr(_placed(local))
    skeleton.CreateBindTransformsAttr(_placed(_summed(local, animation.skeleton)))
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([moves.GetPath()])
    _move(moves, joints, animation, axes)


def _move(moves: Any, joints: Vt.TokenArray, animation: Animation, axes: Axes) -> None:
    places = axes.points(animation.translations)
    turns = axes.turns(animation.rotations)[..., [1, 2, 3, 0]]  # in memory, the real part comes last
    moves.CreateJointsAttr(joints)
    moves.CreateScalesAttr(Vt.Vec3hArray(len(joints), Gf.Vec3h(1)))
    translations, rotations = moves.CreateTranslationsAttr(), moves.CreateRotationsAttr()
    for frame in range(animation.frames):
        translations.Set(Vt.Vec3fArray.FromNumpy(places[frame].astype(np.float32)), frame)
        rotations.Set(Vt.QuatfArray.FromNumpy(turns[frame].astype(np.float32)), frame)


def _paths(skeleton: Skeleton) -> Vt.TokenArray:
    """Every joint as the way to it from the root."""
    names = identifiers(skeleton.names)
    for parent, joint in skeleton.bones:
        names[joint] = f"{names[parent]}/{names[joint]}"
    return Vt.TokenArray(names)


def _summed(local: Float[np.ndarray, "J 3"], skeleton: Skeleton) -> Float[np.ndarray, "J 3"]:
    places = local.copy()
    for parent, joint in skeleton.bones:
        places[joint] += places[parent]
    return places


def _placed(places: Float[np.ndarray, "J 3"]) -> Vt.Matrix4dArray:
    """Translations as the matrices of USD, whose rows hold the axes."""
    return Vt.Matrix4dArray([Gf.Matrix4d(1).SetTranslate(Gf.Vec3d(*place)) for place in places.tolist()])


def _save(stage: Any, path: Path) -> None:
    """Write what USD writes to files of its own only, whole or not at all."""
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / f"stage{path.suffix.lower()}"
        try:
            stage.GetRootLayer().Export(str(made))
        except Tf.ErrorException as error:
            raise UserError(f"cannot write '{path}': {str(error).strip().splitlines()[-1]}") from error
        with atomic_write(path) as file:
            file.write(made.read_bytes())
