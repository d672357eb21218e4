"""glTF documents: numbers read back by our own reader, and files that animations are added to keep all they had."""

from __future__ import annotations

import base64
import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra import numpy as arrays

from scenectl.export.gltf import Document
from scenes.errors import UserError
from scenes.mesh.gltf import Gltf
from tests.scenes.body.rigs import humanoid

PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8z8BQDwAEhQGAhKmMIQAAAABJRU5ErkJggg=="
)
VRM = {
    "specVersion": "1.0",
    "meta": {"name": "hero", "authors": ["us"], "otherLicenseUrl": "", "references": []},
    "humanoid": {"humanBones": {"hips": {"node": 1}}},
    "expressions": {},
    "zero": 0,
    "no": False,
    "nothing": None,
}
TYPES = [np.float32, np.float64, np.uint8, np.uint16, np.uint32]


@given(st.data())
@settings(max_examples=40, deadline=None)
def test_numbers_come_back_whatever_lies_before_them(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    shapes = st.tuples(st.integers(1, 5), st.sampled_from([1, 2, 3, 4, 16]))
    kinds = st.sampled_from(TYPES)
    finite = {"min_value": -(2.0**100), "max_value": 2.0**100}
    tables = [
        data.draw(arrays.arrays(kind, data.draw(shapes), elements=finite if np.dtype(kind).kind == "f" else None))
        for kind in data.draw(st.lists(kinds, min_size=1, max_size=4))
    ]
    document = Document()
    for table in tables:
        document.accessor(table, bounded=True)
    path = tmp_path_factory.mktemp("gltf") / "a.glb"
    document.save(path)
    read = Gltf.read(path)
    for number, table in enumerate(tables):
        np.testing.assert_array_equal(
            read.accessor(number), table.astype(np.float32 if table.dtype.kind == "f" else table.dtype)
        )
        assert read.facts["accessors"][number]["min"] == read.accessor(number).min(axis=0).tolist()
        assert read.facts["bufferViews"][number]["byteOffset"] % 4 == 0


def hero(folder: Path) -> tuple[Path, dict[str, Any]]:
    """A character with a buffer and a picture beside it, and words that only others know."""
    file = humanoid()
    (folder / "hero data.bin").write_bytes(file.binary)
    (folder / "skin.png").write_bytes(PIXEL)
    facts = copy.deepcopy(file.facts) | {
        "buffers": [{"uri": "hero%20data.bin", "byteLength": len(file.binary)}],
        "images": [{"uri": "skin.png", "name": "skin"}],
        "textures": [{"source": 0}],
        "materials": [{"name": "plain", "extensions": {"KHR_materials_unlit": {}}}],
        "extensionsUsed": ["VRMC_vrm", "KHR_materials_unlit"],
        "extensions": {"VRMC_vrm": VRM},
    }
    facts["nodes"][1]["extras"] = {"ours": {"a": [1, 2, {"b": 0}]}}
    facts["meshes"][0]["primitives"][0]["attributes"]["_OWN"] = facts["meshes"][0]["primitives"][0]["attributes"][
        "POSITION"
    ]
    path = folder / "hero.gltf"
    path.write_text(json.dumps(facts))
    return path, facts


def test_a_character_keeps_all_that_it_had(tmp_path: Path) -> None:
    path, before = hero(tmp_path)
    document = Document.open(path)
    times, turns = np.arange(3) / 30, np.tile([0.0, 1.0, 0.0, 0.0], (3, 1))
    document.animation("walk", document.times(times), {(1, "rotation"): turns}, {"fps": 30.0})
    document.save(tmp_path / "out" / "hero.glb")
    file = Gltf.read(tmp_path / "out" / "hero.glb")

    def kept(old: Any, new: Any, where: str) -> None:
        if isinstance(old, dict):
            for key, value in old.items():
                assert key in new, f"{where}.{key} is lost"
                kept(value, new[key], f"{where}.{key}")
        elif isinstance(old, list):
            assert len(old) == len(new) or where == "accessors", where
            for number, pair in enumerate(zip(old, new, strict=False)):  # what is added comes last
                kept(*pair, f"{where}[{number}]")
        else:
            assert old == new, where

    for key in set(before) - {"buffers", "bufferViews", "images"}:
        kept(before[key], file.facts[key], key)
    assert file.facts["extensions"] == {"VRMC_vrm": VRM}
    reader = Gltf.read(path)
    for number in range(len(before["accessors"])):
        np.testing.assert_array_equal(file.accessor(number), reader.accessor(number))
    (image,) = file.facts["images"]
    assert image["mimeType"] == "image/png" and "uri" not in image
    assert file._view(image["bufferView"])[0] == PIXEL
    (made,) = file.facts["animations"]
    assert made["channels"] == [{"sampler": 0, "target": {"node": 1, "path": "rotation"}}]
    assert made["extras"] == {"fps": 30.0} and made["name"] == "walk"
    np.testing.assert_allclose(file.accessor(made["samplers"][0]["input"])[:, 0], times, atol=1e-7)
    np.testing.assert_array_equal(file.accessor(made["samplers"][0]["output"]), np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)))


def test_a_file_that_is_written_again_is_the_same(tmp_path: Path) -> None:
    document = Document.open(hero(tmp_path)[0])
    document.save(tmp_path / "a.glb")
    Document.open(tmp_path / "a.glb").save(tmp_path / "b.glb")
    assert (tmp_path / "a.glb").read_bytes() == (tmp_path / "b.glb").read_bytes()


def test_nodes_hang_where_they_are_put(tmp_path: Path) -> None:
    document = Document()
    top = document.node("top", translation=[1.0, 0.0, 0.0])
    under = document.node("under", top, translation=[0.0, 2.0, 0.0])
    document.save(tmp_path / "a.glb")
    file = Gltf.read(tmp_path / "a.glb")
    assert file.parents == [-1, top] and file.facts["scenes"][0]["nodes"] == [top]
    np.testing.assert_array_equal(file.world[under][:3, 3], [1.0, 2.0, 0.0])


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda facts: facts["buffers"][0].update(uri="gone.bin"), "names the buffer 'gone.bin'"),
        (lambda facts: facts["images"][0].update(uri="gone.png"), "names the image 'gone.png'"),
        (lambda facts: facts["asset"].update(version="1.0"), "is not glTF 2.0"),
        (
            lambda facts: facts["bufferViews"][0].update(extensions={"EXT_meshopt_compression": {}}),
            "has compressed buffers",
        ),
        (lambda facts: facts["bufferViews"][0].update(buffer=7), "not well-formed"),
        (lambda facts: facts.update(nodes=[3]), "not well-formed"),
    ],
)
def test_what_is_not_sound_is_told(spoil: Any, said: str, tmp_path: Path) -> None:
    path, facts = hero(tmp_path)
    spoil(facts)
    path.write_text(json.dumps(facts))
    with pytest.raises(UserError, match=f"^character '.*hero.gltf' .*{said}"):
        Document.open(path)
    with pytest.raises(UserError, match="does not exist"):
        Document.open(tmp_path / "nobody.glb")
