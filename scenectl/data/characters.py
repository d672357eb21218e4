"""Characters and robots from files, with our names for their links where they are people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path

from scenectl.data.joint_names import find_joints, refuse_missing
from scenes.body.body import ProxyBody
from scenes.body.fit import fit_body, fits
from scenes.body.gltf import read_rig
from scenes.body.mjcf import read_robot
from scenes.body.proxies import check_size
from scenes.body.rig import Rig
from scenes.body.urdf import read_urdf
from scenes.errors import UserError

CHARACTERS = (".glb", ".gltf", ".vrm")
READERS = {**dict.fromkeys(CHARACTERS, read_rig), ".urdf": read_urdf, ".xml": read_robot}


def load_character(file: Path) -> tuple[Rig, dict[str, str] | None]:
    """A character or robot, and which of its links are our 22 joints; None where it has no such.

    Raises:
        UserError: a file of another kind, or one that cannot be read.
    """
    if file.suffix.lower() not in READERS:
        raise UserError(
            f"'{file}' is neither a character (.glb, .gltf, .vrm), a robot (.urdf, .xml) nor a fitted body (.json)"
        )
    rig = READERS[file.suffix.lower()](file)
    try:
        joints = joints_of(rig)
    except UserError:  # a robot, or a creature
        return rig, None
    return rig, joints if fits(joints) else None


def character_body(file: Path) -> ProxyBody:
    """The body of a character's file; raises UserError where it has not our 22 joints, or no person's size."""
    try:
        stat = file.stat()
    except OSError:
        return _body(file, 0, 0)
    return _body(file, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=8)
def _body(file: Path, *_: int) -> ProxyBody:
    """The body of a file that was written then, of so many bytes: a run asks for it several times."""
    rig = read_rig(file)
    try:
        body = fit_body(rig, joints_of(rig))
    except UserError as error:
        raise UserError(f"character file '{file}': {error}") from error
    check_size(body, f"character file '{file}'")
    return body


def joints_of(rig: Rig, stated: Mapping[str, str] | None = None) -> dict[str, str]:
    """Which of a rig's links are our 22 joints: as stated, as the file says itself, else by their names.

    Spines are told by the tree. Of all links between the pelvis and what neck and shoulders hang on, that is our
    `spine3`, and `spine1` and `spine2` lie evenly between; where there are fewer, the lower ones are missing. Where
    the spine goes on to the head under one name, its links over the shoulders are neck and head, and its first is the
    pelvis. The pelvis is what hips and neck hang on, whatever else is called so, but where nothing is. Links that move
    triangles come before controls of the same names, where they are all there.

    Raises:
        UserError: joints that are not found, or stated ones that do not exist.
    """
    told = {**rig.known, **(stated or {})}
    bound = {part.link for part in rig.parts} | set(told.values())
    found = _found(rig, told, [link for link, name in enumerate(rig.links) if name in bound])
    if not fits(dict.fromkeys(found, "")):
        found = _found(rig, told, range(len(rig.links)))
    refuse_missing(found, rig.links)
    spine = [] if {"spine1", "spine2", "spine3"} <= found.keys() else _spine(rig, found)
    count = len(spine)
    for k in (1, 2, 3):
        if (at := round(k * count / 3)) and (k == 3 or at < round((k + 1) * count / 3)):
            found.setdefault(f"spine{k}", spine[at - 1])
    return {joint: rig.links[index] for joint, index in found.items()}


def _found(rig: Rig, told: Mapping[str, str], links: Sequence[int]) -> dict[str, int]:
    """Which of some links are our joints but for spines, as told, by their names, and by the tree."""
    found = find_joints([rig.links[link] for link in links], told)
    found = {joint: links[at] for joint, at in found.items()}
    _ends_of_spine(rig, found)
    if "pelvis" not in told and (pelvis := _pelvis(rig, found)) is not None:
        found["pelvis"] = pelvis
    return found


def _pelvis(rig: Rig, found: Mapping[str, int]) -> int | None:
    """What both hips and the neck hang on, if the link that is found for the pelvis is not; None for nothing new."""
    if not {"left_hip", "right_hip", "neck"} <= found.keys():
        return None
    common = _common(rig, [found[name] for name in ("neck", "left_hip", "right_hip")])
    return common[0] if common and found.get("pelvis") not in common else None


def _ends_of_spine(rig: Rig, found: dict[str, int]) -> None:
    """Put neck and head, where neither has a name, on the first and the last link of the spine over the shoulders."""
    if {"neck", "head"} & found.keys() or not {"left_shoulder", "right_shoulder", "left_hip"} <= found.keys():
        return
    hip, names = rig.links[found["left_hip"]], [name.lower() for name in rig.links]
    alike = [k for k, name in enumerate(names) if (i := name.find("spine")) >= 0 and name[:i] == hip[:i].lower()]
    heights = rig.origins[:, 1]
    over = [k for k in alike if heights[k] > min(heights[found["left_shoulder"]], heights[found["right_shoulder"]])]
    if len(over) > 1:
        found["neck"], found["head"] = over[0], over[-1]
        found.setdefault("pelvis", alike[0])


def _spine(rig: Rig, found: Mapping[str, int]) -> list[int]:
    """Links between the pelvis and what the neck and both shoulders hang on, the lowest first."""
    ends = [found[name] for name in ("neck", "left_shoulder", "right_shoulder")]
    common = _common(rig, [end for end in ends if found["pelvis"] in _above(rig, end)])
    if found["pelvis"] not in common:
        return []
    return common[: common.index(found["pelvis"])][::-1]


def _common(rig: Rig, links: Sequence[int]) -> list[int]:
    """All that some links hang on together, the nearest first."""
    ways = [_above(rig, link) for link in links]
    return [link for link in ways[0] if all(link in way for way in ways[1:])] if ways else []


def _above(rig: Rig, link: int) -> list[int]:
    """All links that a link hangs on, the nearest first."""
    way = []
    while (link := rig.parents[link]) >= 0:
        way.append(link)
    return way
