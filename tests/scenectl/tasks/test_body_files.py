"""A task's body is a character's own file: GLB, glTF or VRM, fitted as it is read; what is none is told."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from scenectl.pipeline.run import score
from scenectl.tasks.task import Task, load_task
from scenes.body.gltf import read_rig
from scenes.body.proxies import fit_proxies
from scenes.errors import UserError
from tests.scenectl.retarget.rigs import TALL, hero, small, tall
from tests.scenectl.retarget.walk import walk
from tests.scenes.body.rigs import Gltf, arm, humanoid


def test_a_character_file_is_the_body_that_its_fitted_file_is(tmp_path: Path) -> None:
    small().save(tmp_path / "hero.glb")
    from scenectl.data.characters import joints_of

    rig = read_rig(tmp_path / "hero.glb")
    fit_proxies(rig, joints=joints_of(rig)).save(tmp_path / "hero.json")
    (tmp_path / "task.toml").write_text('prompt = "a person walks"\nseconds = 3.0\nbody = "hero.glb"\n')
    body = load_task(tmp_path / "task.toml").load_body()
    task = Task(prompt="a person walks", seconds=3.0, body="hero.json", folder=tmp_path)
    assert body == task.load_body()
    assert body.height == pytest.approx(1.5, abs=0.08)


def test_vrm_and_gltf_are_bodies_as_well_and_reports_keep_them(tmp_path: Path) -> None:
    tall().save(tmp_path / "hero.vrm")
    file = small()
    (tmp_path / "hero.bin").write_bytes(file.binary)
    facts = {**file.facts, "buffers": [{"uri": "hero.bin", "byteLength": len(file.binary)}]}
    (tmp_path / "hero.gltf").write_text(json.dumps(facts))
    for name, legs in (("hero.vrm", 1.06), ("hero.gltf", 0.71)):
        task = Task(prompt="a person walks", seconds=3.0, body=name, folder=tmp_path)
        assert task.load_body().skeleton.legs == pytest.approx(legs, abs=0.03)
        again = Task(**task.dump())
        assert again.load_body() == task.load_body()


def test_motions_are_scored_on_a_characters_bones(tmp_path: Path) -> None:
    import torch

    from scenes.motion.motion import Motion
    from scenes.motion.rigid import rigid
    from scenes.motion.skeleton import size_of

    small().save(tmp_path / "hero.glb")
    task = Task(prompt="a person walks", seconds=2.0, body="hero.glb", folder=tmp_path)
    joints = torch.from_numpy(walk(2.0).joints).float()
    skeleton = task.load_body().skeleton
    told = score(rigid(Motion(joints), skeleton), task).report["body"]
    assert told["legs"] == pytest.approx(size_of(skeleton), abs=1e-3) and told["legs"] < 0.9


def test_what_is_no_body_is_told(tmp_path: Path) -> None:
    bare = Gltf()
    bare.facts["nodes"].append({"name": "box"})
    bare.save(tmp_path / "bare.glb")
    arm().save(tmp_path / "arm.glb")
    giant = humanoid()
    giant.facts["nodes"][0]["scale"] = [3.0] * 3
    giant.save(tmp_path / "giant.glb")
    hero(TALL, [f"limb{j}" for j in range(22)]).save(tmp_path / "creature.vrm")
    for name, said in {
        "bare.glb": r"character file '.*bare\.glb' has no skin",
        "arm.glb": r"character file '.*arm\.glb': no joint found for .*left_hip",
        "giant.glb": r"character file '.*giant\.glb' holds a body with legs of 2\.\d+ m; motions are made for",
        "creature.vrm": r"character file '.*creature\.vrm': no joint found for",
        "nobody.glb": r"nobody\.glb",
        "hero.txt": r"hero\.txt",
    }.items():
        with pytest.raises(UserError, match=said):
            Task(prompt="a person walks", seconds=3.0, body=name, folder=tmp_path).load_body()
