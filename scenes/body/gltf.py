"""Characters from glTF files: triangles bound to a skeleton.

The reader covers as much of glTF 2.0 as a rig needs: nodes, skins, weights and triangles. Section numbers are those of
the Khronos glTF 2.0 specification.
"""

from __future__ import annotations

import base64
import json
import struct
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from scenes.body.rig import Part, Rig, tree_order
from scenes.errors import UserError
from scenes.motion.frames import rigid, rotations, transform

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6


def read_rig(path: str | Path) -> Rig:
    """Read a character with a skeleton from a GLB or glTF file, in metres with y up as its standard says.

    Every triangle belongs to the joint that has the most weight on its corners, and moves with it as a rigid body: in
    the joint's frame it lies where the file bound it. Several skins are read together where they share joints (a body
    and its clothes). Meshes without a skin move with the joint that they hang on; others are left out. The pose at rest
    is that of the file's nodes; a scale on them is applied to the triangles and taken out of the frames.

    Raises:
        UserError: no such file; not glTF 2.0, cut off, compressed or with sparse accessors; no skin, or several without
            a common joint; no triangles; nodes in a ring; weights that are missing, NaN or name no joint.
    """
    path = Path(path)
    if not path.is_file():
        raise UserError(f"character file '{path}' does not exist")
    try:
        return _rig(path, _File.read(path))
    except UserError as error:
        raise UserError(f"character file '{path}' {error}") from error
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, np.linalg.LinAlgError) as error:
        what = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
        raise UserError(f"character file '{path}' is not well-formed glTF ({what}); export it again") from error


def _rig(path: Path, file: _File) -> Rig:
    joints = file.joints
    names = _names([str(file.nodes[node].get("name") or f"node {node}") for node in joints])
    place = {node: joint for joint, node in enumerate(joints)}
    parents = tuple(place.get(file.above(node, place), -1) for node in joints)
    if not np.isfinite(file.world[joints]).all():
        raise ValueError("a joint's transform is not finite")
    frames = np.stack([rigid(file.world[node]) for node in joints])
    pieces: dict[int, list[np.ndarray]] = {}
    for node in range(len(file.nodes)):
        for joint, triangles in file.triangles(node, place):
            pieces.setdefault(joint, []).append(transform(np.linalg.inv(frames[joint]), triangles))
    if not pieces:
        raise UserError("has no triangles bound to its skeleton; bind a mesh to the joints and export it again")
    parts = []
    for joint in sorted(pieces):
        corners = np.concatenate(pieces[joint])
        if not np.isfinite(corners).all():
            raise ValueError("coordinates are NaN or infinite")
        vertices, faces = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        parts.append(Part(names[joint], frames[joint], vertices, faces.reshape(-1, 3)))
    return Rig(path.stem, str(path), names, parents, frames, tuple(parts))


def _names(given: list[str]) -> tuple[str, ...]:
    """The same names, those used before with a number: frames and reports refer to links by name."""
    names: list[str] = []
    for name in given:
        again = 2
        unique = name
        while unique in names:
            unique, again = f"{name} {again}", again + 1
        names.append(unique)
    return tuple(names)


@dataclass(frozen=True, eq=False)
class _File:
    """The JSON of a file and the bytes that its buffers name."""

    facts: dict[str, Any]
    buffers: list[bytes]

    @classmethod
    def read(cls, path: Path) -> _File:
        """Section 4.4 (GLB) or plain JSON; buffers inside, beside the file or in data URIs."""
        data = path.read_bytes()
        text, binary = _chunks(data) if data[:4] == b"glTF" else (data, None)
        try:
            facts = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise UserError("is neither GLB nor glTF (its JSON cannot be read); export it as glTF 2.0") from error
        if not isinstance(facts, dict) or not str(facts.get("asset", {}).get("version", "")).startswith("2."):
            raise UserError("is not glTF 2.0; export it as such")
        if needed := set(facts.get("extensionsRequired", ())) & _COMPRESSION:
            raise UserError(f"is compressed with {min(needed)}; export it without compression")
        buffers = [_buffer(buffer, binary, path, index) for index, buffer in enumerate(facts.get("buffers", ()))]
        return cls(facts, buffers)

    # ---- the tree of nodes (section 3.5) ----------------------------------------------------------------------------

    @property
    def nodes(self) -> list[dict[str, Any]]:
        """As the file states them."""
        nodes: list[dict[str, Any]] = self.facts.get("nodes", [])
        return nodes

    @cached_property
    def parents(self) -> list[int]:
        """Index of each node's parent, -1 for roots."""
        parents = [-1] * len(self.nodes)
        for node, facts in enumerate(self.nodes):
            for child in facts.get("children", ()):
                if _index(child, self.nodes, "node") == node or parents[child] >= 0:
                    raise ValueError(f"node {child} has two parents")
                parents[child] = node
        return parents

    @cached_property
    def order(self) -> list[int]:
        """Nodes, parents before children."""
        return tree_order(self.parents)

    @cached_property
    def world(self) -> np.ndarray:
        """Transform of each node to the world, ``[N, 4, 4]``."""
        world = np.zeros((len(self.nodes), 4, 4))
        for node in self.order:
            above = np.eye(4) if self.parents[node] < 0 else world[self.parents[node]]
            world[node] = above @ _local(self.nodes[node])
        return world

    def above(self, node: int, among: dict[int, int]) -> int:
        """The nearest node above this one that is one of some; -1 where there is none."""
        node = self.parents[node]
        while node >= 0 and node not in among:
            node = self.parents[node]
        return node

    # ---- skins (section 3.7.3) --------------------------------------------------------------------------------------

    @cached_property
    def joints(self) -> list[int]:
        """Nodes that are joints of a skin, parents before children."""
        skins = self.facts.get("skins", [])
        if not skins:
            raise UserError("has no skin, so nothing says which joint moves which triangle; export it with its rig")
        groups = [{_index(node, self.nodes, "joint") for node in skin["joints"]} for skin in skins]
        together = groups[0]
        for _ in groups:  # clothes may share joints with other clothes only
            together = together.union(*(group for group in groups if group & together))
        if apart := sum(not group & together for group in groups):
            raise UserError(
                f"has {len(groups)} skins, {apart} of them without a joint in common with the first; "
                "export one character a file"
            )
        return [node for node in self.order if node in together]

    def triangles(self, node: int, place: dict[int, int]) -> list[tuple[int, np.ndarray]]:
        """World triangles ``[F, 3, 3]`` of a node's mesh for each joint that owns some."""
        facts = self.nodes[node]
        if "mesh" not in facts:
            return []
        primitives = self.facts["meshes"][_index(facts["mesh"], self.facts["meshes"], "mesh")]["primitives"]
        holder = node if node in place else self.above(node, place)
        found = []
        for primitive in primitives:
            faces = self._faces(primitive)
            if len(faces) == 0:
                continue
            vertices = self.accessor(primitive["attributes"]["POSITION"]).astype(np.float64)
            if faces.max() >= len(vertices):
                raise ValueError(f"triangles name vertices beyond the {len(vertices)} of their mesh")
            if "skin" in facts:
                found += self._bound(self.facts["skins"][facts["skin"]], primitive, vertices, faces, place)
            elif holder >= 0:
                found.append((place[holder], transform(self.world[node], vertices)[faces]))
        return found

    def _bound(
        self, skin: dict[str, Any], primitive: dict[str, Any], vertices: np.ndarray, faces: np.ndarray, place: Any
    ) -> list[tuple[int, np.ndarray]]:
        """World triangles of one skinned primitive, each carried rigidly by its joint."""
        own = skin["joints"]
        slots, weights = self._weights(primitive["attributes"], len(own), len(vertices))
        corners, shares = slots[faces].reshape(len(faces), -1), weights[faces].reshape(len(faces), -1)
        # for every slot, the weight that its joint has on all three corners
        sums = np.stack([(shares * (corners == slot[:, None])).sum(axis=1) for slot in corners.T], axis=1)
        owner = corners[np.arange(len(faces)), sums.argmax(axis=1)]
        bind = np.tile(np.eye(4), (len(own), 1, 1))
        if "inverseBindMatrices" in skin:
            bind = self.accessor(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
            if len(bind) < len(own):
                raise ValueError(f"a skin has {len(own)} joints and {len(bind)} inverse bind matrices")
        return [
            (place[own[j]], transform(self.world[own[j]] @ bind[j], vertices)[faces[owner == j]])
            for j in np.unique(owner)
        ]

    def _weights(self, attributes: dict[str, int], joints: int, vertices: int) -> tuple[np.ndarray, np.ndarray]:
        """Joints ``[V, 4 n]`` (indices into the skin) and weights of every vertex."""
        sets = sorted(name.removeprefix("JOINTS_") for name in attributes if name.startswith("JOINTS_"))
        if not sets or any(f"WEIGHTS_{n}" not in attributes for n in sets):
            raise ValueError("a skinned mesh has no weights")
        slots = np.concatenate([self.accessor(attributes[f"JOINTS_{n}"]).astype(np.int64) for n in sets], axis=1)
        weights = np.concatenate([self.accessor(attributes[f"WEIGHTS_{n}"]).astype(np.float64) for n in sets], axis=1)
        if len(slots) != vertices or len(weights) != vertices:
            raise ValueError(f"{vertices} vertices have {len(slots)} joints and {len(weights)} weights")
        if not np.isfinite(weights).all() or (weights < 0).any() or (weights.sum(axis=1) <= 0).any():
            raise ValueError("weights are NaN, negative or all zero")
        if (slots[weights > 0] >= joints).any():
            raise ValueError(f"weights name joints beyond the {joints} of the skin")
        return np.where(weights > 0, slots, 0), weights

    # ---- geometry (sections 3.6 and 3.7.2) --------------------------------------------------------------------------

    def _faces(self, primitive: dict[str, Any]) -> np.ndarray:
        """Triangles ``[F, 3]`` of a primitive; none of points and lines."""
        mode = primitive.get("mode", _TRIANGLES)
        if mode not in (_TRIANGLES, _STRIP, _FAN):
            return np.zeros((0, 3), dtype=np.int64)
        if "indices" in primitive:
            corners = self.accessor(primitive["indices"]).astype(np.int64).reshape(-1)
        else:
            corners = np.arange(len(self.accessor(primitive["attributes"]["POSITION"])))
        if mode == _TRIANGLES:
            return corners[: len(corners) // 3 * 3].reshape(-1, 3)
        count = np.arange(max(len(corners) - 2, 0))
        if mode == _FAN:
            return np.stack([corners[count + 1], corners[count + 2], np.full(len(count), corners[:1])], axis=1)
        odd = count % 2
        return np.stack([corners[count], corners[count + 1 + odd], corners[count + 2 - odd]], axis=1)

    def accessor(self, index: int) -> np.ndarray:
        """Rows ``[n, width]`` of an accessor; whole numbers that stand for shares come as shares."""
        facts = self.facts["accessors"][_index(index, self.facts["accessors"], "accessor")]
        if "sparse" in facts:
            raise UserError(f"stores accessor {index} sparsely, which is not supported; export it without")
        if "bufferView" not in facts:
            raise UserError(f"has no data for accessor {index} (compressed?); export it without compression")
        width, kind, count = _WIDTHS[facts["type"]], np.dtype(_TYPES[facts["componentType"]]), facts["count"]
        view = self.facts["bufferViews"][_index(facts["bufferView"], self.facts["bufferViews"], "buffer view")]
        row = width * kind.itemsize
        stride, start = view.get("byteStride", row), facts.get("byteOffset", 0)
        length = view["byteLength"]
        data = self.buffers[_index(view["buffer"], self.buffers, "buffer")]
        begin = view.get("byteOffset", 0)
        if not all(isinstance(n, int) and n >= 0 for n in (count, stride, start, length, begin)):
            raise ValueError(f"accessor {index} has sizes that are no whole numbers")
        if stride < row:
            raise ValueError(f"the rows of accessor {index} overlap")
        if count and (start + (count - 1) * stride + row > length or begin + length > len(data)):
            raise UserError(f"is cut off: accessor {index} reaches beyond its buffer; export it again")
        if count == 0:
            return np.zeros((0, width), dtype=kind)
        rows = np.ndarray((count, width), kind, data, begin + start, (stride, kind.itemsize))
        if not facts.get("normalized"):
            return rows
        return np.maximum(rows / np.iinfo(kind).max, -1.0)


_COMPRESSION = {"KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"}


def _chunks(data: bytes) -> tuple[bytes, bytes | None]:
    """JSON and binary chunk of a GLB file."""
    if len(data) < 20:
        raise UserError("is cut off after its header; export it again")
    version, length, size, kind = struct.unpack_from("<IIII", data, 4)
    if version != 2:
        raise UserError(f"is GLB version {version}, and only 2 is read; export it as glTF 2.0")
    if length > len(data) or 20 + size > len(data):
        raise UserError(f"is cut off: it holds {len(data)} of {max(length, 20 + size)} bytes; export or copy it again")
    if kind != 0x4E4F534A:
        raise UserError("is not GLB: its first chunk is no JSON; export it again")
    text, rest = data[20 : 20 + size], data[20 + size : length]
    if len(rest) < 8:
        return text, None
    size, kind = struct.unpack_from("<II", rest)
    if 8 + size > len(rest):
        raise UserError("is cut off within its binary chunk; export or copy it again")
    return text, rest[8 : 8 + size] if kind == 0x004E4942 else None


def _buffer(facts: dict[str, Any], binary: bytes | None, path: Path, index: int) -> bytes:
    uri = facts.get("uri")
    if uri is None:
        if binary is None:
            raise UserError(f"has no data for buffer {index}; export it again")
        return binary
    if uri.startswith("data:"):
        return base64.b64decode(uri.partition(",")[2], validate=True)
    beside = path.parent / unquote(uri)
    if "://" in uri or not beside.is_file():
        raise UserError(f"names the buffer '{uri}', which is not beside it; copy it there, or export a GLB")
    return beside.read_bytes()


def _index(value: Any, among: Any, what: str) -> int:
    """An index as the file states it; Python would take negative ones to count from the end."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < len(among):
        raise ValueError(f"there is no {what} {value}")
    return value


def _local(node: dict[str, Any]) -> np.ndarray:
    """Transform of a node to its parent, ``[4, 4]``."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64)
    turn = rotations(np.array([w, x, y, z]))
    local = np.eye(4)
    local[:3, :3] = turn * np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    local[:3, 3] = np.array(node.get("translation", (0, 0, 0)), dtype=np.float64)
    return local
