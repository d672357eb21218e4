"""glTF 2.0 files: buffers, accessors, the tree of nodes, and the triangles that hang on it.

`read_gltf` reads scenes, and `scenes.body.gltf` characters. Section numbers are those of the Khronos glTF 2.0
specification.
"""

from __future__ import annotations

import base64
import json
import re
import struct
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import unquote

import numpy as np

from scenes.errors import UserError, shown
from scenes.files import unreadable
from scenes.mesh.content import Content, Piece, distinct, joined, placed
from scenes.motion.frames import rotations
from scenes.motion.skeleton import tree_order

File = TypeVar("File", bound="Gltf")

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_DRACO, _INSTANCING = "KHR_draco_mesh_compression", "EXT_mesh_gpu_instancing"
_VISIBILITY = "KHR_node_visibility"
_MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_READ = {"KHR_mesh_quantization", _DRACO, _INSTANCING, _VISIBILITY, *_MESHOPT}
_NO_GEOMETRY = re.compile(
    r"[A-Z]+_(materials|texture|lights|animation|audio|xmp|techniques|primitive_outline|structural_metadata|"
    r"mesh_features|instance_features|springBone)(_|$)"
)
"""Extensions that may be required and say nothing on where triangles are: how they look, light, move and sound."""


def read_gltf(path: Path) -> Content:
    """Read the default scene of a GLB or glTF file: a piece for each node with a mesh, in metres with y up.

    Raises:
        UserError: not glTF 2.0; cut off; a buffer that is not there; an extension that is required and not read.
        KeyError, IndexError, TypeError, ValueError: not well-formed.
    """
    return Gltf.read(path).content()


@dataclass(frozen=True, eq=False)
class Gltf:
    """The JSON of a file and the bytes that it names.

    Attributes:
        facts: the JSON.
        path: where it lies, and what its buffers' addresses are relative to.
        binary: the binary chunk of a GLB file.
    """

    facts: dict[str, Any]
    path: Path
    binary: bytes | None
    _known: dict[tuple[str, int], Any] = field(default_factory=dict)

    @classmethod
    def read(cls: type[File], path: Path) -> File:
        """Section 4.4 (GLB) or plain JSON."""
        data = path.read_bytes()
        if not data.strip():
            raise UserError("is empty; export it again")
        text, binary = _chunks(data) if b"glTF".startswith(data[:4]) else (data, None)
        try:
            facts = json.loads(text)
        except (ValueError, RecursionError) as error:
            if isinstance(error, json.JSONDecodeError) and _ends_early(error):
                raise UserError("is cut off within its JSON; export or copy it again") from error
            raise UserError("is neither GLB nor glTF (its JSON cannot be read); export it as glTF 2.0") from error
        if not isinstance(facts, dict) or not str(facts.get("asset", {}).get("version", "")).startswith("2."):
            raise UserError("is not glTF 2.0; export it as such")
        for name in facts.get("extensionsRequired", ()):
            if name not in _READ and not _NO_GEOMETRY.match(name):
                raise UserError(f"requires the extension {name}, which is not read; export it without")
        return cls(facts, path, binary)

    def content(self) -> Content:
        """A piece for each node of the default scene that has triangles, named as the node is."""
        names, meshes, skinned = [], [], []
        for node in self.drawn:
            facts = self.nodes[node]
            shapes = [shape for primitive in self.primitives(node) if len((shape := self.shape(primitive, node))[1])]
            copies = [placed(frame, *shape) for frame in self.places(node) for shape in shapes]
            if copies:
                names.append(str(facts.get("name") or f"node {node}"))
                meshes.append(joined(copies))
                skinned += names[-1:] if "skin" in facts else []
        return Content(
            [Piece(name, *mesh) for name, mesh in zip(distinct(names), meshes, strict=True)], self._posed(skinned)
        )

    def _posed(self, nodes: list[str]) -> tuple[str, ...]:
        """A doubt on meshes that a skeleton may bend."""
        if not nodes:
            return ()
        return (
            f"'{self.path.name}' binds {len(nodes)} meshes such as '{nodes[0]}' to a skeleton, and they are read as "
            "modelled, not as posed; apply the pose before export where it matters",
        )

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
                if numbered(child, self.nodes, "node") == node or parents[child] >= 0:
                    raise ValueError(f"node {child} has two parents")
                parents[child] = node
        return parents

    @cached_property
    def order(self) -> list[int]:
        """Nodes, parents before children."""
        return tree_order(self.parents)

    @cached_property
    def drawn(self) -> list[int]:
        """Nodes of the default scene, or of the first, or all: parents before children, the last of siblings first.

        A node that is stated to be invisible is left out with all below it (KHR_node_visibility).
        Bakes depend on the order of triangles in their last bits; this is the one that scenes always had.
        """
        if scenes := self.facts.get("scenes"):
            waiting = list(scenes[numbered(self.facts.get("scene", 0), scenes, "scene")].get("nodes", ()))
        else:
            waiting = [node for node, parent in enumerate(self.parents) if parent < 0]
        assert len(self.order) == len(self.nodes)  # no rings
        found = dict[int, None]()
        while waiting:
            node = numbered(waiting.pop(), self.nodes, "node")
            shown = self.nodes[node].get("extensions", {}).get(_VISIBILITY, {}).get("visible", True)
            if shown and node not in found:
                found[node] = None
                waiting += self.nodes[node].get("children", ())
        return list(found)

    @cached_property
    def world(self) -> np.ndarray:
        """Transform of each node to the world, ``[N, 4, 4]``."""
        world = np.zeros((len(self.nodes), 4, 4))
        for node in self.order:
            local = _local(self.nodes[node])
            world[node] = local if self.parents[node] < 0 else world[self.parents[node]] @ local
        return world

    def places(self, node: int) -> np.ndarray:
        """Transforms to the world of all copies of a node's mesh, ``[n, 4, 4]``: one, or its instances."""
        instances = self.nodes[node].get("extensions", {}).get(_INSTANCING)
        if instances is None:
            return self.world[node][None]
        attributes = instances["attributes"]
        rows = {name: self.accessor(attributes[name]) for name in _REST if name in attributes}
        count = {len(given) for given in rows.values()}
        if len(count) != 1:
            raise ValueError(f"node {node} has instances without transforms, or with several numbers of them")
        frames = _frames(*(rows.get(name, np.tile(rest, (max(count), 1))) for name, rest in _REST.items()))
        return self.world[node] @ frames

    # ---- triangles (section 3.7.2) ----------------------------------------------------------------------------------

    def primitives(self, node: int) -> list[dict[str, Any]]:
        """Of the node's mesh, where it has one."""
        if "mesh" not in self.nodes[node]:
            return []
        meshes = self.facts["meshes"]
        primitives: list[dict[str, Any]] = meshes[numbered(self.nodes[node]["mesh"], meshes, "mesh")]["primitives"]
        return primitives

    def shape(self, primitive: dict[str, Any], node: int) -> tuple[np.ndarray, np.ndarray]:
        """Vertices ``[V, 3]`` in the node's frame and triangles ``[F, 3]``, morphed as the file shows them first."""
        faces = self._faces(primitive) if "POSITION" in primitive["attributes"] else np.zeros((0, 3), dtype=np.int64)
        if not len(faces):
            return np.zeros((0, 3)), faces
        vertices = self.attribute(primitive, "POSITION").astype(np.float64)
        mesh = self.facts["meshes"][self.nodes[node]["mesh"]]
        weights = self.nodes[node].get("weights", mesh.get("weights", ()))
        for weight, target in zip(weights, primitive.get("targets", ()), strict=False):
            if weight and "POSITION" in target:
                vertices = vertices + weight * self.accessor(target["POSITION"])
        if faces.max() >= len(vertices):
            raise ValueError(f"triangles name vertices beyond the {len(vertices)} of their mesh")
        return vertices, faces

    def _faces(self, primitive: dict[str, Any]) -> np.ndarray:
        """Triangles ``[F, 3]`` of a primitive; none of points and lines."""
        mode = primitive.get("mode", _TRIANGLES)
        if mode not in (_TRIANGLES, _STRIP, _FAN):
            return np.zeros((0, 3), dtype=np.int64)
        if (packed := self._draco(primitive)) is not None:
            return np.asarray(packed.faces, dtype=np.int64).reshape(-1, 3)
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

    def attribute(self, primitive: dict[str, Any], name: str) -> np.ndarray:
        """Rows ``[V, width]`` of an attribute of a primitive, compressed or not."""
        index = primitive["attributes"][name]
        if (packed := self._draco(primitive)) is None:
            return self.accessor(index)
        rows = packed.get_attribute_by_unique_id(primitive["extensions"][_DRACO]["attributes"][name])["data"]
        return _shares(np.asarray(rows), self.facts["accessors"][index])

    def _draco(self, primitive: dict[str, Any]) -> Any:
        """The decoded mesh of a primitive whose data is in no accessor; None for others."""
        packed = primitive.get("extensions", {}).get(_DRACO)
        positions = primitive.get("attributes", {}).get("POSITION")
        if packed is None or "bufferView" in self._accessor_facts(positions):
            return None
        return self._once("draco", packed["bufferView"], lambda: _unpacked(_DRACO, self._view(packed["bufferView"])[0]))

    # ---- numbers (section 3.6) --------------------------------------------------------------------------------------

    def _accessor_facts(self, index: int) -> dict[str, Any]:
        accessors = self.facts["accessors"]
        facts: dict[str, Any] = accessors[numbered(index, accessors, "accessor")]
        return facts

    def accessor(self, index: int) -> np.ndarray:
        """Rows ``[n, width]`` of an accessor; whole numbers that stand for shares come as shares."""
        facts, what = self._accessor_facts(index), f"accessor {index}"
        shape = facts["count"], _known(_WIDTHS, facts, "type", what)
        kind = _known(_TYPES, facts, "componentType", what)
        if "bufferView" not in facts and "sparse" not in facts:
            raise UserError(f"has no data for {what}; export it again, without compression")
        if "bufferView" in facts:
            rows = self._rows(facts, shape, kind, what)
        elif shape[0] > _MOST:
            raise ValueError(f"{what} has {shape[0]} rows")
        else:
            rows = np.zeros(shape, kind)
        if "sparse" in facts:
            sparse = facts["sparse"]
            count, places = sparse["count"], sparse["indices"]
            whole = _known(_TYPES, places, "componentType", what)
            where = self._rows(places, (count, 1), whole, what)[:, 0]
            rows = rows.copy()
            rows[where] = self._rows(sparse["values"], (count, shape[1]), kind, what)
        return _shares(rows, facts)

    def _rows(self, facts: dict[str, Any], shape: tuple[int, int], kind: str, what: str) -> np.ndarray:
        """Rows of numbers that lie in a buffer view."""
        data, stride = self._view(facts["bufferView"])
        count, row = shape[0], shape[1] * np.dtype(kind).itemsize
        start, stride = facts.get("byteOffset", 0), stride or row
        if not all(isinstance(n, int) and n >= 0 for n in (count, stride, start)):
            raise ValueError(f"{what} has sizes that are no whole numbers")
        if stride < row:
            raise ValueError(f"the rows of {what} overlap")
        if count and start + (count - 1) * stride + row > len(data):
            raise UserError(f"is cut off: {what} reaches beyond its buffer; export it again")
        if count == 0:
            return np.zeros(shape, kind)
        return np.ndarray(shape, kind, data, start, (stride, np.dtype(kind).itemsize))

    def _view(self, index: int) -> tuple[bytes, int]:
        """Bytes of a buffer view, and from one row to the next; 0 where rows follow each other."""
        views = self.facts["bufferViews"]
        facts = views[numbered(index, views, "buffer view")]
        for name in _MESHOPT:
            packed = facts.get("extensions", {}).get(name)
            if packed is not None and not self._has_data(facts["buffer"]):
                make = partial(_unpacked, name, self._slice(packed, index), packed)
                return self._once("view", index, make), packed["byteStride"]
        return self._slice(facts, index), facts.get("byteStride", 0)

    def _slice(self, facts: dict[str, Any], index: int) -> bytes:
        """What a view says it takes of its buffer."""
        begin, length = facts.get("byteOffset", 0), facts["byteLength"]
        if not all(isinstance(n, int) and n >= 0 for n in (begin, length)):
            raise ValueError(f"buffer view {index} has sizes that are no whole numbers")
        data = self._once("buffer", facts["buffer"], lambda: self.buffer(facts["buffer"]))
        if begin + length > len(data):
            raise UserError(f"is cut off: buffer view {index} reaches beyond its buffer; export it again")
        return data[begin : begin + length]

    def _once(self, kind: str, index: int, make: Any) -> Any:
        if (kind, index) not in self._known:
            self._known[kind, index] = make()
        return self._known[kind, index]

    def _has_data(self, index: int) -> bool:
        buffer = self.facts["buffers"][numbered(index, self.facts["buffers"], "buffer")]
        return "uri" in buffer or (index == 0 and self.binary is not None)

    def buffer(self, index: int) -> bytes:
        """Bytes of a buffer, wherever they lie."""
        if not self._has_data(index):
            raise UserError(f"has no data for buffer {index}; export it again")
        uri = self.facts["buffers"][index].get("uri")
        if uri is None:
            assert self.binary is not None
            return self.binary
        return self.named(uri, "buffer")

    def named(self, uri: str, what: str) -> bytes:
        """What an address stands for: bytes beside the file or in a data URI (sections 3.6.1 and 4.4.3)."""
        if uri.startswith("data:"):
            return base64.b64decode(unquote(uri.partition(",")[2]), validate=True)
        beside = [self.path.parent / name for name in (unquote(uri), uri)]
        found = next((file for file in beside if "://" not in uri and file.is_file()), None)
        if found is None:
            raise UserError(
                f"names the {what} '{unquote(uri)}', which is not in '{self.path.parent}'; "
                "copy it there, or export a GLB"
            )
        if fault := unreadable(found):
            raise UserError(f"names the {what} '{unquote(uri)}', which {fault}")
        return found.read_bytes()


_MOST = 1 << 24
"""Rows that an accessor without data of its own may have: 200 MB of positions."""
_REST: dict[str, tuple[float, ...]] = {
    "TRANSLATION": (0.0, 0.0, 0.0), "ROTATION": (0.0, 0.0, 0.0, 1.0), "SCALE": (1.0, 1.0, 1.0),
}  # fmt: skip


def _known(table: dict[Any, Any], facts: dict[str, Any], key: str, what: str) -> Any:
    """What a word or number of the standard stands for; raises ValueError, which names it, for any other."""
    if facts[key] not in table:
        raise ValueError(f"{what} has the {key} {facts[key]}, and glTF 2.0 knows {', '.join(map(str, table))}")
    return table[facts[key]]


def _shares(rows: np.ndarray, facts: dict[str, Any]) -> np.ndarray:
    """Whole numbers that stand for shares of 1, as these (section 3.6.2.1)."""
    if not facts.get("normalized") or rows.dtype.kind == "f":
        return rows
    return np.maximum(rows / np.iinfo(rows.dtype).max, -1.0)


def _unpacked(extension: str, data: bytes, view: dict[str, Any] | None = None) -> Any:
    """A Draco mesh, or the bytes of a view that meshoptimizer compressed; by libraries that few files need."""
    try:
        if view is None:
            import DracoPy

            return DracoPy.decode(data)
        import meshopt

        how = (view["count"], view["byteStride"], view["mode"], view.get("filter", "NONE"))
        return np.asarray(meshopt.decode_gltf_buffer(data, *how)).tobytes()
    except ImportError as error:
        raise UserError(
            f"is compressed with {extension}; install 'scenectl[compressed]', which reads it, or export it without"
        ) from error
    except Exception as error:  # each library raises its own kinds
        raise UserError(f"is compressed with {extension} and damaged ({error}); export it again, without") from error


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


def _ends_early(error: json.JSONDecodeError) -> bool:
    """JSON is right up to its end, or to the word or string that its end breaks off."""
    text = error.doc.rstrip()
    return text.lstrip()[:1] == "{" and (error.pos > len(text) - len("false") or "Unterminated" in error.msg)


def numbered(value: Any, among: Any, what: str) -> int:
    """An index as the file states it; Python would take negative ones to count from the end."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < len(among):
        raise ValueError(f"there is no {what} {shown(value)}")
    return value


def _local(node: dict[str, Any]) -> np.ndarray:
    """Transform of a node to its parent, ``[4, 4]``."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    return _frames(*(np.array([node.get(name.lower(), rest)]) for name, rest in _REST.items()))[0]


def _frames(translation: np.ndarray, rotation: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Transforms ``[n, 4, 4]`` that scale, turn by quaternions (x, y, z, w) and move."""
    frames = np.tile(np.eye(4), (len(translation), 1, 1))
    turns = rotations(np.roll(np.asarray(rotation, dtype=np.float64), 1, axis=1))
    frames[:, :3, :3] = turns * np.asarray(scale, dtype=np.float64)[:, None]
    frames[:, :3, 3] = np.asarray(translation, dtype=np.float64)
    return frames
