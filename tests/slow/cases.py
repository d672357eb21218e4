"""What is exported, and where everything should then be, in Blender's axes."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from scenectl.export.animation import Animation
from scenectl.export.export import export
from scenectl.export.mannequin import Mannequin
from scenectl.export.names import PRESETS, named
from scenectl.export.settings import Settings
from scenectl.retarget.characters.character import Character
from scenectl.retarget.characters.playing import play
from scenectl.tasks.task import load_task
from scenes.motion.bones import rest_pose
from scenes.motion.motion import Motion
from scenes.world.scene import Scene
from tests.scenectl.retarget.rigs import small, tall

MOMENTS = 10


@dataclass
class Moment:
    """Where things are at a time (s): joints by name, corners of the person's mesh and of what moves (m, z up)."""

    time: float
    joints: dict[str, list[float]]
    mesh: list[list[float]] = field(default_factory=list)
    things: dict[str, list[list[float]]] = field(default_factory=dict)


@dataclass
class Play:
    """One animation in a file."""

    name: str
    moments: list[Moment]


@dataclass
class Case:
    """A file, what it should show, the frame of its first moment in Blender, and where a picture goes, if one does."""

    file: str
    picture: str
    fps: float
    first: int
    rest: dict[str, list[float]]
    plays: list[Play]

    def table(self) -> dict[str, Any]:
        return asdict(self)


def files(root: Path, out: Path) -> Iterator[tuple[Motion, Path, Settings]]:
    """What is written: a motion, or several, by the ending of a path. A door swings while somebody walks up to it."""
    motion, scene = walked(root, out)
    best, room = motion[0], Settings(scene=scene, t0=motion.t0)
    for ending in ("bvh", "glb", "usd"):
        yield best, out / f"walk.{ending}", Settings()
        yield best, out / f"at_60.{ending}", Settings(fps=60)
        for preset in PRESETS:
            yield best, out / f"{preset}.{ending}", Settings(names=preset, fps=30)
    yield motion, out / "samples.glb", room
    for name, rig in {"mixamo_1.5_m": small(), "vrm_1.95_m": tall()}.items():
        yield best, out / f"hero_{name}.glb", replace(room, character=rig.save(out / f"{name}.glb"))
    yield best, out / "room.usda", room
    yield best, out / "z_up.usdc", replace(room, up="z", unit="cm", names="mixamo")


def walked(root: Path, out: Path) -> tuple[Motion, Scene]:
    """A motion by the command line, made once, and its scene."""
    task, made = root / "examples" / "tasks" / "swinging_door.toml", out / "door"
    if not (made / "motion.npz").exists():
        subprocess.run([sys.executable, "-m", "scenectl.cli.app", "run", task, "-o", made], cwd=root, check=True)
    return Motion.load(made / "motion.npz"), load_task(task).load_scene()


def exported(motion: Motion, path: Path, settings: Settings) -> Case:
    """Write a file, and say where everything in it should be."""
    export(motion, path, settings)
    motions = [motion] if motion.joints.ndim == 3 else [motion[i] for i in range(len(motion.joints))]
    fps = settings.fps or motion.fps
    picture = "" if settings.fps else f"{path}.png"  # where nothing else differs
    plays, rest = [], {}
    for place, one in enumerate(motions):
        name = path.stem if len(motions) == 1 else f"{path.stem}_{place}"
        animation = named(Animation.of(one, name)[0], settings.names)
        names = joint_names(animation, path.suffix)
        rest = dict(zip(names, blenders(rest_pose(animation.skeleton).numpy()), strict=True))
        if settings.character is not None:
            plays.append(Play(name, played(animation, settings)))
            rest = {}
            continue
        plays.append(Play(name, moments(one, animation, names, fps, settings, path.suffix)))
    return Case(str(path), picture, fps, int(path.suffix == ".bvh"), rest, plays)


def joint_names(animation: Animation, suffix: str) -> list[str]:
    """Names of joints as the format has them."""
    if not suffix.startswith(".usd"):
        return list(animation.skeleton.names)
    from scenectl.export.usd import identifiers

    return identifiers(animation.skeleton.names)


def moments(
    motion: Motion, animation: Animation, names: list[str], fps: float, settings: Settings, suffix: str
) -> list[Moment]:
    """At times that are whole frames of the motion and of the file.

    Our joints are where the motion has them, others where the animation does.
    """
    joints = motion.joints[motion.valid].numpy()
    whole = [f for f in range(animation.frames) if abs(f / motion.fps * fps - round(f / motion.fps * fps)) < 1e-9]
    found = []
    for frame in np.array(whole)[np.linspace(0, len(whole) - 1, MOMENTS).round().astype(int)].tolist():
        places = animation.joints[frame].copy()
        places[animation.ours] = joints[frame]
        moment = Moment(frame / motion.fps, dict(zip(names, blenders(places), strict=True)))
        if suffix == ".bvh" and animation.hips is not None:
            del moment.joints[names[0]]  # no part of the body; it carries the pelvis, which has no place of its own
        if suffix != ".bvh":
            moment.mesh = blenders(skinned(animation, frame))
        if settings.scene is not None:
            seen = (*settings.scene.meshes, *(thing.mesh(motion.t0 + moment.time) for thing in settings.scene.objects))
            moment.things = {mesh.name: blenders(mesh.vertices[np.unique(mesh.faces)]) for mesh in seen}
        found.append(moment)
    return found


def played(animation: Animation, settings: Settings) -> list[Moment]:
    """Where the character's joints are by its file's nodes, whose names are the file's."""
    assert settings.character is not None
    hero = Character.load(settings.character)
    does = play(hero, animation.skeleton, animation.rotations, animation.roots, animation.fps)
    worlds, nodes = does.worlds(hero.file)[:, :, :3, 3], hero.joints.values()
    names = [hero.file.nodes[node]["name"] for node in nodes]
    every = np.linspace(0, animation.frames - 1, MOMENTS).round().astype(int).tolist()
    return [
        Moment(frame / animation.fps, dict(zip(names, blenders(worlds[frame, list(nodes)]), strict=True)))
        for frame in every
    ]


def skinned(animation: Animation, frame: int) -> np.ndarray:
    """Corners of the mannequin, each where its joints carry it, ``[V, 3]``."""
    skin, ours = Mannequin.of(animation), animation.ours
    rest = rest_pose(animation.skeleton).numpy()[ours]
    rest -= rest[0]
    moved = np.zeros_like(skin.vertices)
    for joint, place in enumerate(animation.joints[frame, ours]):
        turn = Rotation.from_quat(animation.orientations[frame, ours[joint]], scalar_first=True)
        share = np.where(skin.joints == joint, skin.weights, 0.0).sum(axis=1)[:, None]
        moved += share * (turn.apply(skin.vertices - rest[joint]) + place)
    return moved


def blenders(points: np.ndarray) -> Any:
    """Points (y up, facing +z) as Blender has them, z up, facing -y."""
    x, y, z = np.moveaxis(np.asarray(points, np.float64), -1, 0)
    return np.stack([x, -z, y], axis=-1).tolist()
