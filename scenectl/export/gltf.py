"""glTF documents to be written as GLB files, over pygltflib: new ones, and those that animations are added to."""

from __future__ import annotations

import copy
import json
import mimetypes
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pygltflib

from scenectl.version import __version__
from scenes.errors import UserError
from scenes.files import atomic_write, readable
from scenes.mesh.colours import linear
from scenes.mesh.content import told
from scenes.mesh.gltf import Gltf

VERTICES, INDICES = 34962, 34963
"""What a buffer view is bound to when it is drawn."""
_KINDS = {"f4": 5126, "u1": 5121, "u2": 5123, "u4": 5125}
_SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}

Tracks: TypeAlias = Mapping[tuple[int, str], np.ndarray]
"""Keys by node and by what moves: translations ``[T, 3]`` (m), rotations ``[T, 4]`` (w, x, y, z), scales ``[T, 3]``."""


class Document:
    """A glTF document with one buffer, in metres, y up.

    Attributes:
        gltf: its JSON as pygltflib's objects, to be looked at and changed.
    """

    def __init__(self, gltf: pygltflib.GLTF2 | None = None, data: bytes = b"") -> None:
        """A new document with one empty scene, or one that was read and its binary data."""
        self.gltf = gltf or pygltflib.GLTF2(
            asset=pygltflib.Asset(generator=f"scenectl {__version__}"),
            scene=0,
            scenes=[pygltflib.Scene(nodes=[])],
            buffers=[pygltflib.Buffer()],
        )
        self._data = bytearray(data)

    @classmethod
    def open(cls, path: str | Path) -> Document:
        """Read a GLB, glTF or VRM file with all its buffers and images, wherever they lie.

        Raises:
            UserError: no such file, or it isn't sound; compressed buffers, of which others depend on the layout.
        """
        path = readable(path, "character")
        with told(f"character '{path}'", "glTF"):
            return cls(*_in_one(Gltf.read(path)))

    # ---- numbers ----------------------------------------------------------------------------------------------------

    def view(self, data: bytes, target: int | None = None) -> int:
        """Put bytes into the buffer; returns the buffer view."""
        start = _append(self._data, data)
        self.gltf.bufferViews.append(
            pygltflib.BufferView(buffer=0, byteOffset=start, byteLength=len(data), target=target)
        )
        return len(self.gltf.bufferViews) - 1

    def accessor(self, rows: np.ndarray, target: int | None = None, bounded: bool = False) -> int:
        """Put rows ``[n]`` or ``[n, w]`` into the buffer, floats as float32, whole numbers as they are typed.

        Args:
            rows: of numbers; unsigned ones of 1, 2 or 4 bytes where they are whole.
            target: `VERTICES`, `INDICES` or None.
            bounded: state the least and the greatest of each column, as positions and times of keys need it.
        """
        rows = np.ascontiguousarray(rows, "<f4" if rows.dtype.kind == "f" else rows.dtype.newbyteorder("<"))
        table = rows.reshape(len(rows), -1)
        bounds = {"min": table.min(axis=0).tolist(), "max": table.max(axis=0).tolist()} if bounded else {}
        self.gltf.accessors.append(
            pygltflib.Accessor(
                bufferView=self.view(rows.tobytes(), target),
                componentType=_KINDS[rows.dtype.str[1:]],
                count=len(rows),
                type=_SHAPES[table.shape[1]],
                **bounds,
            )
        )
        return len(self.gltf.accessors) - 1

    # ---- what is seen -----------------------------------------------------------------------------------------------

    def material(self, name: str, colour: Sequence[int], double_sided: bool = False) -> int:
        """A matt material of an sRGB colour (0 to 255)."""
        shares = linear(np.asarray(colour)).round(4).tolist()
        look = pygltflib.PbrMetallicRoughness(baseColorFactor=[*shares, 1.0], metallicFactor=0.0, roughnessFactor=0.9)
        self.gltf.materials.append(pygltflib.Material(name=name, pbrMetallicRoughness=look, doubleSided=double_sided))
        return len(self.gltf.materials) - 1

    def mesh(self, name: str, parts: Iterable[tuple[np.ndarray, int]], **vertices: np.ndarray) -> int:
        """A mesh.

        Args:
            name: of it.
            parts: faces ``[F, 3]`` and the material of each.
            **vertices: what its vertices have, as the standard names it: POSITION ``[V, 3]`` (m), NORMAL, JOINTS_0, ...
        """
        attributes = {key: self.accessor(rows, VERTICES, bounded=key == "POSITION") for key, rows in vertices.items()}
        kind = np.uint16 if len(vertices["POSITION"]) < 2**16 else np.uint32
        primitives = [
            pygltflib.Primitive(
                attributes=pygltflib.Attributes(**attributes),
                indices=self.accessor(faces.astype(kind).reshape(-1), INDICES),
                material=material,
            )
            for faces, material in parts
        ]
        self.gltf.meshes.append(pygltflib.Mesh(name=name, primitives=primitives))
        return len(self.gltf.meshes) - 1

    # ---- nodes ------------------------------------------------------------------------------------------------------

    def node(self, name: str, parent: int | None = None, **stated: Any) -> int:
        """A node on a parent, or on the scene; `stated` are fields of `pygltflib.Node`, such as its translation."""
        self.gltf.nodes.append(pygltflib.Node(name=name, **stated))
        index = len(self.gltf.nodes) - 1
        siblings = self.gltf.scenes[self.gltf.scene or 0].nodes if parent is None else self.gltf.nodes[parent].children
        siblings.append(index)
        return index

    def skin(self, name: str, joints: Sequence[int], bind: np.ndarray, skeleton: int | None = None) -> int:
        """A skin of some nodes, whose frames are at ``bind`` ``[J, 4, 4]`` in the mesh's where it lies as modelled."""
        inverse = np.linalg.inv(bind).transpose(0, 2, 1).reshape(-1, 16)  # column after column
        self.gltf.skins.append(
            pygltflib.Skin(
                name=name, joints=list(joints), inverseBindMatrices=self.accessor(inverse), skeleton=skeleton
            )
        )
        return len(self.gltf.skins) - 1

    # ---- what moves -------------------------------------------------------------------------------------------------

    def times(self, times: np.ndarray) -> int:
        """Times ``[T]`` (s) of keys, for the animations that share them."""
        return self.accessor(np.asarray(times, dtype=np.float32), bounded=True)

    def animation(self, name: str, times: int, tracks: Tracks, extras: dict[str, Any] | None = None) -> int:
        """An animation whose keys lie at `times` and are joined by lines and, of rotations, even turns."""
        made = pygltflib.Animation(name=name, extras=extras or {})
        for (node, what), keys in tracks.items():
            rows = np.roll(keys, -1, axis=1) if what == "rotation" else keys  # the standard's x, y, z, w
            made.channels.append(
                pygltflib.AnimationChannel(
                    sampler=len(made.samplers), target=pygltflib.AnimationChannelTarget(node=node, path=what)
                )
            )
            made.samplers.append(
                pygltflib.AnimationSampler(input=times, output=self.accessor(rows), interpolation="LINEAR")
            )
        self.gltf.animations.append(made)
        return len(self.gltf.animations) - 1

    # ---- out --------------------------------------------------------------------------------------------------------

    def save(self, path: str | Path) -> None:
        """Write a GLB file, whole or not at all; raises UserError for a path that cannot be written."""
        self.gltf.buffers[0].byteLength = len(self._data)
        for accessor in self.gltf.accessors:
            if accessor.bufferView is None:  # sparse, or compressed: pygltflib puts a zero, and it may not have any
                accessor.byteOffset = None
        self.gltf.set_binary_blob(bytes(self._data))
        with atomic_write(path) as out:
            out.writelines(self.gltf.save_to_bytes())


def _in_one(file: Gltf) -> tuple[pygltflib.GLTF2, bytes]:
    """A document whose buffers and images are all in one piece of binary data, and that."""
    facts: dict[str, Any] = copy.deepcopy(file.facts)
    data, starts = bytearray(), []
    for index in range(len(facts.get("buffers", ()))):
        starts.append(_append(data, file.buffer(index)))
    for view in facts.setdefault("bufferViews", []):
        if any("meshopt" in name for name in view.get("extensions", ())):
            raise UserError("has compressed buffers, to which no animation can be added; export it without")
        view["byteOffset"] = view.get("byteOffset", 0) + starts[view["buffer"]]
        view["buffer"] = 0
    for image in facts.get("images", ()):
        if (uri := image.get("uri", "data:")).startswith("data:"):
            continue
        content = file.named(image.pop("uri"), "image")
        image |= {"mimeType": mimetypes.guess_type(uri)[0], "bufferView": len(facts["bufferViews"])}
        facts["bufferViews"].append({"buffer": 0, "byteOffset": _append(data, content), "byteLength": len(content)})
    facts["buffers"] = [{"byteLength": len(data)}]
    return pygltflib.GLTF2.from_json(json.dumps(facts), infer_missing=True), bytes(data)


def _append(data: bytearray, more: bytes) -> int:
    """Put bytes behind others, for pygltflib to align each view when it writes; returns where they begin."""
    data += more
    return len(data) - len(more)
