"""glTF files: numbers as stored, nodes where they stand, and a sentence for what is not read."""

from __future__ import annotations

import base64
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings, strategies as st

from scenes.errors import UserError
from scenes.mesh.gltf import Gltf as Reader
from scenes.mesh.mesh import Mesh, load_mesh, load_parts
from tests.scenes.body.rigs import KINDS, WIDTHS, Gltf

WHOLE = ("<i1", "<u1", "<i2", "<u2", "<u4")
BOX = trimesh.creation.box(extents=[2, 2, 2])


def bare() -> Gltf:
    file = Gltf()
    del file.facts["skins"]
    return file


def boxes(*nodes: dict[str, Any], vertices: np.ndarray = BOX.vertices, **primitive: Any) -> Gltf:
    """A 2 m box around the origin under every node."""
    file = bare()
    indices = file.add(BOX.faces.reshape(-1, 1), "<u2")
    shape = {"attributes": {"POSITION": file.add(vertices)}, "indices": indices, **primitive}
    file.facts["meshes"].append({"primitives": [shape]})
    file.facts["nodes"] = [{"mesh": 0, **node} for node in nodes or ({},)]
    file.facts["scenes"][0]["nodes"] = list(range(len(file.facts["nodes"])))
    return file


def volume(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    return float((a * np.cross(b, c)).sum() / 6)


def stored(
    file: Gltf, rows: np.ndarray, kind: str, gap: int = 0, skip: int = 0, changes: Any = None, zeros: bool = False
) -> int:
    """An accessor whose rows are `gap` bytes apart, `skip` bytes into their view, with sparse changes."""
    size = np.dtype(kind).itemsize
    table = np.zeros((len(rows), rows.shape[1] * size + gap), np.uint8)
    table[:, : rows.shape[1] * size] = rows.astype(kind).view(np.uint8).reshape(len(rows), -1)
    facts: dict[str, Any] = {"componentType": KINDS[kind], "count": len(rows), "type": WIDTHS[rows.shape[1]]}
    if not zeros:
        view = {"buffer": 0, "byteOffset": len(file.binary), "byteLength": skip + table.nbytes}
        file.binary += bytes(skip) + table.tobytes()
        file.facts["bufferViews"].append(view if gap == 0 else {**view, "byteStride": table.shape[1]})
        facts |= {"bufferView": len(file.facts["bufferViews"]) - 1, "byteOffset": skip}
    if changes is not None:
        where, values, index_kind = changes
        places = file.facts["accessors"][file.add(where.reshape(-1, 1), index_kind)]["bufferView"]
        new = file.facts["accessors"][file.add(values.astype(kind), kind)]["bufferView"]
        facts["sparse"] = {
            "count": len(where),
            "indices": {"bufferView": places, "componentType": KINDS[index_kind]},
            "values": {"bufferView": new},
        }
    file.facts["accessors"].append(facts)
    return len(file.facts["accessors"]) - 1


@settings(max_examples=80, deadline=None)
@given(
    st.sampled_from([*WHOLE, "<f4"]), st.booleans(), st.integers(0, 3), st.integers(0, 3),
    st.sampled_from([1, 3, 4, 16]), st.sampled_from([None, "<u1", "<u2", "<u4"]), st.booleans(), st.integers(0, 10**6),
)  # fmt: skip
def test_accessors_come_back_as_they_were_written(
    tmp_path_factory: pytest.TempPathFactory, kind: str, normalized: bool, gap: int, skip: int, width: int,
    index_kind: str | None, zeros: bool, seed: int,
) -> None:  # fmt: skip
    rng = np.random.default_rng(seed)
    count, whole = int(rng.integers(1, 30)), kind != "<f4"
    low, high = (np.iinfo(kind).min, np.iinfo(kind).max) if whole else (-1e3, 1e3)

    def numbers(rows: int) -> np.ndarray:
        drawn = (
            rng.integers(low, high, (rows, width), endpoint=True) if whole else rng.uniform(low, high, (rows, width))
        )
        return drawn.astype(kind)

    rows, changes = numbers(count), None
    zeros = zeros and index_kind is not None
    expected = np.zeros_like(rows) if zeros else rows.copy()
    if index_kind is not None:
        where = rng.choice(count, int(rng.integers(1, count + 1)), replace=False)
        changes = (where, numbers(len(where)), index_kind)
        expected[where] = changes[1]
    file = bare()
    index = stored(file, rows, kind, 4 * gap, 4 * skip, changes, zeros)
    if normalized and whole:
        file.facts["accessors"][index]["normalized"] = True
        expected = np.maximum(expected / np.iinfo(kind).max, -1.0)
    found = Reader.read(file.save(tmp_path_factory.mktemp("a") / "a.glb")).accessor(index)
    assert np.array_equal(found, expected)


@pytest.mark.parametrize("kind", ["<i1", "<u1", "<i2", "<u2"])
def test_quantised_positions_are_shares_of_one_or_plain_numbers(tmp_path: Path, kind: str) -> None:
    """KHR_mesh_quantization, as gltfpack and glTF-Transform write it: the node scales them back."""
    most = np.iinfo(kind).max
    rows = np.round((BOX.vertices + 1) / 2 * most)
    for normalized, scale in ((True, 4.0), (False, 4.0 / most)):
        file = boxes({"scale": [scale] * 3})
        index = stored(file, rows, kind, gap=-3 * np.dtype(kind).itemsize % 4)
        file.facts["accessors"][index]["normalized"] = normalized
        file.facts["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = index
        file.facts["extensionsRequired"] = ["KHR_mesh_quantization"]
        mesh = load_mesh(file.save(tmp_path / "a.glb"))
        np.testing.assert_allclose(mesh.bounds, [[0, 0, 0], [4, 4, 4]], atol=1e-6)
        assert volume(mesh) == pytest.approx(64.0, rel=1e-5)


@pytest.mark.parametrize("kind", ["<f4", "<i1", "<i2"])
def test_instances_stand_where_their_attributes_say(tmp_path: Path, kind: str) -> None:
    rng = np.random.default_rng(3)
    moves, sizes = rng.uniform(-5, 5, (4, 3)), rng.uniform(0.2, 2, (4, 3)) * [1, 1, -1]
    turns = rng.normal(size=(4, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    file = boxes({"translation": [0.0, 10.0, 0.0], "name": "crate"})
    stated = turns if kind == "<f4" else np.round(turns * np.iinfo(kind).max)
    rotation = stored(file, stated, kind)
    file.facts["accessors"][rotation]["normalized"] = kind != "<f4"
    attributes = {
        "TRANSLATION": file.add(moves),
        "ROTATION": rotation,
        "SCALE": file.add(sizes),
        "_ID": file.add(moves),
    }
    file.facts["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    file.facts["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    parts = load_parts(file.save(tmp_path / "a.glb"))
    assert list(parts) == ["crate"]
    from scipy.spatial.transform import Rotation

    exact = stated if kind == "<f4" else np.maximum(stated / np.iinfo(kind).max, -1)
    copies = [
        Rotation.from_quat(turn).apply(BOX.vertices * size) + move + [0, 10, 0]
        for turn, size, move in zip(exact, sizes, moves, strict=True)
    ]
    tolerance = {"<f4": 1e-5, "<i2": 1e-3, "<i1": 0.2}[kind]  # rounded quaternions are not quite of unit length
    np.testing.assert_allclose(parts["crate"].vertices, np.concatenate(copies), atol=tolerance)
    assert volume(parts["crate"]) == pytest.approx(8 * np.abs(sizes.prod(axis=1)).sum(), rel=tolerance)


def test_mirrored_nodes_keep_their_fronts_outside(tmp_path: Path) -> None:
    nodes = [
        {"scale": [-1.0, 1.0, 1.0]},
        {"matrix": [0.0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1]},
        {"scale": [-1.0, -1.0, 1.0], "translation": [10.0, 0, 0]},
    ]
    parts = load_parts(boxes(*nodes).save(tmp_path / "a.glb"))
    assert [round(volume(part), 5) for part in parts.values()] == [8.0, 8.0, 8.0]


@pytest.mark.parametrize(
    ("mode", "corners"), [(5, [0, 1, 2, 3, 4, 5]), (6, [2, 4, 5, 3, 1, 0]), (4, None), (None, None)]
)
@pytest.mark.parametrize("indexed", [True, False])
def test_strips_fans_and_triangles_with_and_without_indices(
    tmp_path: Path, mode: int | None, corners: list[int] | None, indexed: bool
) -> None:
    ladder = np.array([[x, y, 0.0] for x in range(3) for y in range(2)])
    corners = corners or [0, 2, 1, 1, 2, 3, 2, 4, 3, 3, 4, 5]
    flipped = np.array([corners]).T
    file = boxes(vertices=ladder if indexed else ladder[corners])
    primitive = file.facts["meshes"][0]["primitives"][0]
    primitive["indices"] = file.add(flipped, "<u1")
    if not indexed:
        del primitive["indices"]
    if mode is not None:
        primitive["mode"] = mode
    mesh = load_mesh(file.save(tmp_path / "a.glb"))
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    normals = np.cross(b - a, c - a)[:, 2] / 2
    assert len(normals) == 4 and abs(normals.sum()) == pytest.approx(2.0)
    assert (np.sign(normals) == np.sign(normals[0])).all()


def test_only_the_default_scene_is_read_and_a_mesh_may_stand_under_several_nodes(tmp_path: Path) -> None:
    file = boxes(
        {"name": "a"}, {"name": "a", "translation": [5.0, 0, 0]}, {"name": "lost", "translation": [99.0, 0, 0]}
    )
    file.facts["nodes"].append({"children": [1], "translation": [0.0, 3.0, 0.0]})
    file.facts["scenes"] = [{"nodes": [2]}, {"nodes": [0, 3]}]
    file.facts["scene"] = 1
    parts = load_parts(file.save(tmp_path / "a.glb"))
    assert sorted(parts) == ["a", "a 2"]  # names given twice are numbered
    assert load_mesh(tmp_path / "a.glb").bounds.tolist() == [[-1, -1, -1], [6, 4, 1]]
    del file.facts["scene"]
    assert load_mesh(file.save(tmp_path / "a.glb")).bounds[0, 0] == 98
    del file.facts["scenes"]  # a library: everything
    assert len(load_parts(file.save(tmp_path / "a.glb"))) == 3


def test_primitives_with_and_without_material_are_one_part(tmp_path: Path) -> None:
    file = boxes({"name": "two"})
    first = file.facts["meshes"][0]["primitives"][0]
    file.facts["materials"] = [{}]
    file.facts["meshes"][0]["primitives"] += [{**first, "material": 0}, {**first, "mode": 1}, {**first, "mode": 0}]
    parts = load_parts(file.save(tmp_path / "a.glb"))
    assert {name: len(part.faces) for name, part in parts.items()} == {"two": 24}


def test_morph_targets_count_as_the_file_weighs_them(tmp_path: Path) -> None:
    file = boxes({}, {"weights": [0.0, 1.0], "translation": [10.0, 0, 0]})
    lift = np.array([1, 7])
    top = stored(file, np.zeros((8, 3)), "<f4", changes=(lift, np.full((2, 3), 4.0), "<u1"), zeros=True)
    primitive = file.facts["meshes"][0]["primitives"][0]
    primitive["targets"] = [{"POSITION": top}, {"NORMAL": top}]
    file.facts["meshes"][0]["weights"] = [0.5, 0.0]
    parts = load_parts(file.save(tmp_path / "a.glb"))
    assert parts["node 0"].bounds.max() == 3.0 and parts["node 1"].bounds[1].tolist() == [11, 1, 1]


@pytest.mark.parametrize("address", ["my room.bin", "my%20room.bin", "sub/r%C3%A4ume.bin", "100%25.bin"])
def test_buffers_beside_the_file_by_any_address(tmp_path: Path, address: str) -> None:
    from urllib.parse import unquote

    file = boxes()
    (tmp_path / unquote(address)).parent.mkdir(exist_ok=True)
    (tmp_path / unquote(address)).write_bytes(file.binary)
    facts = {**file.facts, "buffers": [{"byteLength": len(file.binary), "uri": address}]}
    (tmp_path / "a.gltf").write_text(json.dumps(facts))
    assert volume(load_mesh(tmp_path / "a.gltf")) == pytest.approx(8.0)
    (tmp_path / unquote(address)).unlink()
    with pytest.raises(UserError) as told:
        load_mesh(tmp_path / "a.gltf")
    assert unquote(address) in str(told.value) and str(tmp_path) in str(told.value)


@pytest.mark.parametrize("head", ["data:application/octet-stream;base64,", "data:application/gltf-buffer;base64,"])
def test_buffers_inside_the_file(tmp_path: Path, head: str) -> None:
    file = boxes()
    uri = head + base64.b64encode(file.binary).decode()
    for text in (uri, uri.replace("=", "%3D")):
        facts = {**file.facts, "buffers": [{"byteLength": len(file.binary), "uri": text}]}
        (tmp_path / "a.gltf").write_text(json.dumps(facts))
        assert volume(load_mesh(tmp_path / "a.gltf")) == pytest.approx(8.0)


HARMLESS = (
    "KHR_materials_unlit", "KHR_materials_pbrSpecularGlossiness", "KHR_texture_transform", "KHR_texture_basisu",
    "EXT_texture_webp", "MSFT_texture_dds", "KHR_lights_punctual", "EXT_lights_image_based", "KHR_animation_pointer",
    "KHR_xmp_json_ld", "VRMC_materials_mtoon", "EXT_structural_metadata", "CESIUM_primitive_outline",
)  # fmt: skip


@pytest.mark.parametrize("name", HARMLESS)
def test_extensions_that_leave_triangles_alone_may_be_required(tmp_path: Path, name: str) -> None:
    file = boxes()
    file.facts["extensionsRequired"] = [name]
    assert volume(load_mesh(file.save(tmp_path / "a.glb"))) == pytest.approx(8.0)


@pytest.mark.parametrize("name", ["CESIUM_RTC", "MSFT_lod", "KHR_binary_glTF", "ACME_geometry", "ADOBE_materials2"])
def test_other_extensions_that_are_required_are_refused_by_name(tmp_path: Path, name: str) -> None:
    file = boxes()
    file.facts["extensionsUsed"] = [name]
    assert len(load_mesh(file.save(tmp_path / "a.glb")).faces) == 12
    file.facts["extensionsRequired"] = [name]
    with pytest.raises(UserError, match=f"requires the extension {name}, which is not read"):
        load_mesh(file.save(tmp_path / "a.glb"))


def draco(file: Gltf, data: bytes) -> Gltf:
    """The box's data replaced by a Draco mesh."""
    primitive = file.facts["meshes"][0]["primitives"][0]
    for index in (primitive["attributes"]["POSITION"], primitive["indices"]):
        del file.facts["accessors"][index]["bufferView"]
    view = file.facts["accessors"][file.add(np.frombuffer(data, np.uint8)[:, None], "<u1")]["bufferView"]
    packed = {"bufferView": view, "attributes": {"POSITION": 0}}
    primitive["extensions"] = {"KHR_draco_mesh_compression": packed}
    file.facts["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    return file


def meshopt(file: Gltf, encode: Any) -> Gltf:
    """The views of the box compressed, in a buffer of their own, before a fallback without data."""
    packed = b""
    for view, (mode, stride) in zip(file.facts["bufferViews"], [("TRIANGLES", 2), ("ATTRIBUTES", 12)], strict=True):
        rows = np.frombuffer(file.binary, np.uint8)[view["byteOffset"] :][: view["byteLength"]].reshape(-1, stride)
        data = encode(rows, mode)
        facts = {"buffer": 0, "byteOffset": len(packed), "byteLength": len(data), "count": len(rows)}
        view["extensions"] = {"EXT_meshopt_compression": {**facts, "byteStride": stride, "mode": mode}}
        view["buffer"] = 1
        packed += data + bytes(-len(data) % 4)
    file.facts["extensionsRequired"] = ["EXT_meshopt_compression"]
    fallback = {"byteLength": len(file.binary), "extensions": {"EXT_meshopt_compression": {"fallback": True}}}
    file.facts["buffers"] = [{"byteLength": len(packed)}, fallback]
    file.binary = packed
    return file


def test_draco_is_decoded_or_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="compressed with KHR_draco_mesh_compression"):
        load_mesh(draco(boxes(), b"no Draco data").save(tmp_path / "a.glb"))
    DracoPy = pytest.importorskip("DracoPy")
    data = DracoPy.encode(BOX.vertices.astype(np.float32), BOX.faces.astype(np.uint32), quantization_bits=14)
    mesh = load_mesh(draco(boxes({"translation": [0.0, 1.0, 0.0]}), data).save(tmp_path / "a.glb"))
    np.testing.assert_allclose(mesh.bounds, [[-1, 0, -1], [1, 2, 1]], atol=1e-3)
    assert volume(mesh) == pytest.approx(8.0, rel=1e-3)


def test_meshopt_is_decoded_or_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="compressed with EXT_meshopt_compression"):
        load_mesh(meshopt(boxes(), lambda rows, mode: b"nothing like it").save(tmp_path / "a.glb"))
    library = pytest.importorskip("meshopt")

    def encode(rows: np.ndarray, mode: str) -> bytes:
        data: bytes = library.encode_gltf_buffer(rows.view("<u2").reshape(-1) if mode == "TRIANGLES" else rows, mode)
        return data

    mesh = load_mesh(meshopt(boxes(), encode).save(tmp_path / "a.glb"))
    assert mesh.bounds.tolist() == [[-1, -1, -1], [1, 1, 1]] and volume(mesh) == pytest.approx(8.0)


def test_fallbacks_of_compression_are_read(tmp_path: Path) -> None:
    """Files that state plain data beside the compressed are read without any library."""
    file = meshopt(boxes(), lambda rows, mode: b"nothing like it")
    plain = boxes().binary
    (tmp_path / "plain.bin").write_bytes(plain)
    file.facts["buffers"][1]["uri"] = "plain.bin"
    (tmp_path / "packed.bin").write_bytes(file.binary)
    file.facts["buffers"][0]["uri"] = "packed.bin"
    del file.facts["extensionsRequired"]
    (tmp_path / "a.gltf").write_text(json.dumps(file.facts))
    assert volume(load_mesh(tmp_path / "a.gltf")) == pytest.approx(8.0)
    file = boxes()
    packed = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
    file.facts["meshes"][0]["primitives"][0]["extensions"] = packed
    assert volume(load_mesh(file.save(tmp_path / "b.glb"))) == pytest.approx(8.0)


@pytest.mark.parametrize("required", [True, False])
def test_invisible_nodes_are_left_out_with_all_below_them(tmp_path: Path, required: bool) -> None:
    def shown(visible: bool) -> dict[str, Any]:
        return {"extensions": {"KHR_node_visibility": {"visible": visible}}}

    file = boxes({"name": "a"}, {**shown(True), "name": "b"}, {**shown(False), "children": [3]}, {"name": "below"})
    file.facts["scenes"][0]["nodes"] = [0, 1, 2]
    file.facts["extensionsUsed"] = ["KHR_node_visibility"]
    if required:
        file.facts["extensionsRequired"] = ["KHR_node_visibility"]
    assert set(load_parts(file.save(tmp_path / "a.glb"))) == {"a", "b"}


def test_what_is_wrong_is_one_sentence(tmp_path: Path) -> None:
    def refused(sentence: str, **facts: Any) -> None:
        file = boxes()
        for key, value in facts.items():
            file.facts[key] = value
        with pytest.raises(UserError, match=sentence) as told:
            load_mesh(file.save(tmp_path / "a.glb"))
        assert "\n" not in str(told.value)

    refused("there is no scene 7", scene=7)
    refused("there is no node 9", scenes=[{"nodes": [9]}])
    refused("no triangles", nodes=[{}], scenes=[{"nodes": [0]}])
    refused("each other's parents", nodes=[{"mesh": 0, "children": [1]}, {"children": [0]}])
    refused("there is no mesh 4", nodes=[{"mesh": 4}])
    refused("NaN or infinite", nodes=[{"mesh": 0, "translation": [math.nan, 0, 0]}])
    refused("not glTF 2.0", asset={"version": "1.0"})
    for key, value in (("componentType", 5131), ("componentType", None), ("type", "MAT7")):
        accessors = [{**accessor, key: value} for accessor in boxes().facts["accessors"]]
        refused(rf"accessor \d has the {key} {value}, and glTF 2.0 knows ", accessors=accessors)


def test_a_mesh_on_a_skeleton_is_doubted_in_a_scene(tmp_path: Path) -> None:
    file = boxes({"skin": 0, "name": "guest"}, {})
    (doubt,) = load_mesh(file.save(tmp_path / "a.glb")).doubts
    assert "'guest'" in doubt and "not as posed" in doubt
