"""The user's own characters in GLB and VRM files: all that their file holds, and the motions that they play."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from scipy.spatial.transform import Rotation

from scenectl.export.animation import Animation
from scenectl.export.glb import add_room
from scenectl.export.gltf import Document, Tracks
from scenectl.export.settings import Settings
from scenectl.retarget.characters.character import Character, apart
from scenectl.retarget.characters.playing import Played, play
from scenes.errors import UserError
from scenes.mesh.content import distinct

_VRM = {"VRM", "VRMC_vrm"}


def write(animations: Sequence[Animation], path: Path, settings: Settings) -> None:
    """Write the character with an animation for each motion, which come first: tools play the first by default.

    Animations that the file holds already stay, but for those of the same names. The character rests as it did.

    Raises:
        UserError: what `Character.load` refuses; a VRM file of what is none; a path that cannot be written.
    """
    assert settings.character is not None
    character = Character.load(settings.character, settings.joints)
    if path.suffix.lower() == ".vrm" and not _VRM & character.file.facts.get("extensions", {}).keys():
        raise UserError(f"'{settings.character}' is no VRM, and '{path}' would be none; write a .glb file")
    document = Document.open(settings.character)
    before, document.gltf.animations = document.gltf.animations, []
    moved = add_room(document, animations, settings)
    names = distinct(animation.name for animation in animations)
    for name, animation, moving in zip(names, animations, moved, strict=True):
        motion = animation.skeleton, animation.rotations, animation.roots, animation.fps
        played = play(character, *motion, travels=settings.root_motion)
        _plain(document, character, played)
        tracks = {**_tracks(played), **moving}
        document.animation(name, document.times(animation.times), tracks, {"fps": animation.fps})
    document.gltf.animations += [old for old in before if old.name not in names]
    document.save(path)


def _tracks(played: Played) -> Tracks:
    turns = {(node, "rotation"): rotations for node, rotations in played.rotations.items()}
    return {**{(node, "translation"): places for node, places in played.translations.items()}, **turns}


def _plain(document: Document, character: Character, played: Played) -> None:
    """State by translation, rotation and scale how nodes rest that are animated: a matrix cannot be."""
    for index in played.rotations:
        node = document.gltf.nodes[index]
        if node.matrix is not None:
            place, turn, scale = apart(character.file.nodes[index])
            node.matrix, node.translation, node.scale = None, place.tolist(), scale.tolist()
            node.rotation = Rotation.from_matrix(turn).as_quat().tolist()
