"""Characters and robots from files, with our names for their links where they are people."""

from __future__ import annotations

from pathlib import Path

from scenectl.data.joint_names import match_joints
from scenes.body.fit import fits
from scenes.body.gltf import read_rig
from scenes.body.mjcf import read_robot
from scenes.body.rig import Rig
from scenes.body.urdf import read_urdf
from scenes.errors import UserError

READERS = {".glb": read_rig, ".gltf": read_rig, ".urdf": read_urdf, ".xml": read_robot}


def load_character(file: Path) -> tuple[Rig, dict[str, str] | None]:
    """A character or robot, and which of its links are our 22 joints; None where it has no such.

    Raises:
        UserError: a file of another kind, or one that cannot be read.
    """
    if file.suffix.lower() not in READERS:
        raise UserError(
            f"'{file}' is neither a character (.glb, .gltf), a robot (.urdf, .xml) nor a fitted body (.json)"
        )
    rig = READERS[file.suffix.lower()](file)
    try:
        joints = {joint: rig.links[index] for joint, index in match_joints(rig.links).items()}
    except UserError:  # a robot, or a creature
        return rig, None
    return rig, joints if fits(joints) else None
