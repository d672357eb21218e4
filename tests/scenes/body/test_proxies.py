"""Capsules on links: they cover, they are stored, they move with frames and know how far they are from things."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial.transform import Rotation

from scenes.body.body import DEFAULT_BODY
from scenes.body.capsules import sample_surface
from scenes.body.fit import PLACED, fit_body
from scenes.body.gltf import read_rig
from scenes.body.proxies import FittedPart, Proxies, fit_part, fit_proxies, load_body
from scenes.body.rig import Part, Rig
from scenes.body.urdf import read_urdf
from scenes.errors import UserError
from scenes.mesh.primitives import Box, Capsule, Plane, Sphere
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D
from scenes.motion.waypoints import Waypoints
from tests.scenes.body.rigs import arm, humanoid, other_person, robot, standing

NAMES = {name: name for name in HUMANML3D.names}


@pytest.fixture(scope="module")
def lamp(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    return read_urdf(robot(tmp_path_factory.mktemp("lamp")))


@pytest.fixture(scope="module")
def person(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    return read_rig(humanoid().save(tmp_path_factory.mktemp("person") / "person.glb"))


def outside(part: FittedPart, points: np.ndarray) -> float:
    """The farthest that points (in the link's frame) stick out of all capsules, naively."""
    share = np.linspace(0, 1, 400)[:, None]
    away = []
    for capsule in part.capsules:
        centres = (1 - share) * np.array(capsule.a) + share * np.array(capsule.b)
        away.append(np.linalg.norm(points[:, None] - centres, axis=2).min(axis=1) - capsule.radius)
    return max(0.0, float(np.min(away, axis=0).max()))


def ell() -> Part:
    """Two long boxes at a right angle: one capsule is loose, two are not."""
    a, b = Box((0.5, 0, 0), (1.0, 0.1, 0.1)).mesh(), Box((0, 0.55, 0), (0.1, 1.0, 0.1)).mesh()
    return Part(
        "ell", np.eye(4), np.concatenate([a.vertices, b.vertices]), np.concatenate([a.faces, b.faces + len(a.vertices)])
    )


def test_capsules_of_an_arm_are_its_capsules(tmp_path: Path) -> None:
    found = fit_proxies(read_rig(arm(0.01).save(tmp_path / "arm.glb")))
    assert [(p.link, len(p.capsules), p.reference) for p in found.parts] == [("upper", 1, "mesh"), ("lower", 1, "mesh")]
    for part, length, radius in zip(found.parts, (0.3, 0.25), (0.06, 0.04), strict=True):
        assert (part.capsules[0].length, part.capsules[0].radius) == pytest.approx((length, radius), abs=1e-5)
        assert 1.0 < part.volume_ratio < 1.02 and part.uncovered < 1e-6
    assert 1.0 < found.volume_ratio < 1.02


@pytest.mark.parametrize("capsules", [1, 4])
def test_every_vertex_is_covered_and_more_capsules_are_never_looser(lamp: Rig, capsules: int) -> None:
    one, found = fit_proxies(lamp), fit_proxies(lamp, capsules=capsules)
    for part, tight, loose in zip(lamp.parts, found.parts, one.parts, strict=True):
        assert outside(tight, part.vertices) < 1e-4 and tight.uncovered <= 1e-6
        assert tight.volume <= loose.volume * (1 + 1e-9) and len(tight.capsules) <= capsules


def test_a_part_with_a_corner_is_split_where_it_pays() -> None:
    part = ell()
    one, two, many = (fit_part(part, capsules=n) for n in (1, 2, 5))
    assert two.volume < 0.3 * one.volume and len(two.capsules) == 2
    assert len(many.capsules) <= 5 and many.volume <= two.volume
    surface = np.concatenate([part.vertices, sample_surface(part.vertices, part.faces, 2000)])
    assert outside(two, surface) < 1e-3


def test_what_sticks_out_of_a_partial_cover_is_measured(lamp: Rig) -> None:
    for part in lamp.parts[:2]:
        found = fit_part(part, 0.9)
        points = np.concatenate([part.vertices, sample_surface(part.vertices, part.faces, 3000)])
        assert found.uncovered == pytest.approx(outside(found, points), abs=1e-4)
        assert (found.capsules[0].distance(points[len(part.vertices) :]) <= 1e-6).mean() > 0.88
        assert found.volume <= fit_part(part).volume * (1 + 1e-3)
    box = fit_part(lamp.parts[1], 0.9)
    assert box.uncovered > 0.002


def test_proxies_turn_and_grow_with_their_part() -> None:
    part, turn = ell(), Rotation.from_euler("xyz", [0.4, 1.0, -2.0]).as_matrix()
    moved = replace(part, vertices=10 * part.vertices @ turn.T + [3.0, -5.0, 1.0])
    a, b = fit_part(part, capsules=2), fit_part(moved, capsules=2)
    assert b.volume == pytest.approx(1000 * a.volume, rel=1e-3)
    assert b.volume_ratio == pytest.approx(a.volume_ratio, rel=1e-3)


def test_flat_parts_are_covered_and_said_to_be_flat() -> None:
    square = Part(
        "flat", np.eye(4), np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
    )
    found = fit_part(square, capsules=3)
    assert math.isinf(found.volume_ratio) and found.uncovered < 1e-6
    needle = Part("needle", np.eye(4), np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([[0, 1, 2]]))
    thin = fit_part(needle, capsules=3)
    assert thin.uncovered < 1e-9 and thin.capsules[0].radius < 1e-9


def test_stored_proxies_come_back_equal(lamp: Rig, person: Rig, tmp_path: Path) -> None:
    for found in (fit_proxies(lamp, capsules=2), fit_proxies(person, joints=NAMES)):
        found.save(tmp_path / "body.json")
        again = Proxies.load(tmp_path / "body.json")
        assert again == found and (again.body is None) == (found.body is None)
        assert again.volume_ratio == found.volume_ratio


def test_broken_body_files_are_told_in_one_sentence(lamp: Rig, tmp_path: Path) -> None:
    path = tmp_path / "body.json"
    with pytest.raises(UserError, match="does not exist"):
        Proxies.load(path)
    found = fit_proxies(lamp)
    found.save(path)
    text = path.read_text()
    table = json.loads(text)

    def changed(**facts: object) -> str:
        return json.dumps({**table, **facts})

    part = table["parts"][0]
    broken = [
        (text[:300], "not JSON"),
        ("[1]", "format"),
        (changed(format="other"), "format"),
        (changed(parts=3), "damaged at parts"),
        (changed(parts=[]), "damaged"),
        (changed(parents=[-1, 0, 1, 2, 4]), "no tree"),
        (changed(links=table["links"][:2]), "no tree"),
        (changed(rest=[[[1]]]), "not 4 by 4"),
        (changed(parts=[{**part, "link": "leg"}]), "no link 'leg'"),
        (changed(parts=[{**part, "capsules": [{**part["capsules"][0], "radius": -1.0}]}]), "cannot be"),
        (changed(parts=[{**part, "capsules": [{**part["capsules"][0], "radius": math.nan}]}]), "finite"),
    ]
    body = asdict(DEFAULT_BODY)
    sphere, bone = body["spheres"][0], body["capsules"][0]
    broken += [
        (changed(body={**body, "spheres": [{**sphere, "joint": 99}]}), "joints beyond its 22"),
        (changed(body={**body, "capsules": [{**bone, "a": -3}]}), "joints beyond its 22"),
        (changed(body={**body, "capsules": [{**bone, "radius": 1e-12}]}), "radii from"),  # 10^11 samples
        (changed(body={**body, "spheres": [{**sphere, "radius": math.nan}]}), "damaged at body"),
        (changed(body={**body, "sole_offset": 1e30}), "damaged at body"),
        (changed(body={**body, "sole_offset": True}), "damaged at body"),
        (changed(rest=[[[1e300] * 4] * 4] * 4), "damaged"),
        (changed(coverage="1"), "damaged at coverage"),
        (changed(parts=[{**part, "capsules": []}]), "cannot be"),
        (changed(parts=[{**part, "self": 1, "capsules": [{**part["capsules"][0], "a": [1e300, 0, 0]}]}]), "damaged"),
    ]
    for content, sentence in broken:
        path.write_text(content)
        with pytest.raises(UserError, match=sentence) as told:
            Proxies.load(path)
        assert str(path) in str(told.value) and "\n" not in str(told.value)


def test_capsules_move_with_their_links(lamp: Rig) -> None:
    found = fit_proxies(lamp)
    rest = found.place(found.frames)
    assert rest.shape == (4, 2, 3)
    base = rest[0].mean(dim=0)
    torch.testing.assert_close(base, torch.tensor([0.0, 0.05, 0.0], dtype=torch.float64), atol=1e-6, rtol=0)
    frames = found.frames.repeat(2, 3, 1, 1, 1)
    shift = torch.randn(2, 3, 5, 3, dtype=torch.float64)
    frames[..., :3, 3] += shift
    moved = found.place(frames)
    torch.testing.assert_close(moved - rest, shift[:, :, [0, 1, 2, 3], None].expand(-1, -1, -1, 2, -1))
    with pytest.raises(UserError, match=r"frames have shape \[4, 4, 4\]; give \[\*b, 5, 4, 4\]"):
        found.place(found.frames[:4])


def test_clearance_is_the_distance_of_the_capsules_surface(lamp: Rig) -> None:
    found = fit_proxies(lamp)
    frames = found.frames
    floor = found.clearance(Plane((0, -1, 0)), frames)
    exact = (found.place(frames)[..., 1].amin(dim=-1) + 1) - found.radii
    torch.testing.assert_close(floor, exact)  # at a flat surface the ends decide
    ball = Sphere((0.4, 0.35, 0.1), 0.02)
    near = found.clearance(ball, frames)
    for clearance, (a, b), radius in zip(near, found.place(frames), found.radii, strict=True):
        point = torch.tensor([ball.center], dtype=torch.float64)
        true = Capsule(a.tolist(), b.tolist(), float(radius)).distance(point)[0] - ball.radius
        assert 0 <= clearance - true + 1e-9 <= radius / 4 + 1e-9
    assert found.clearance(Sphere((0.0, 0.3, 0.0), 0.01), frames)[1] < 0  # inside the arm


def test_clearances_of_a_batch_are_those_of_a_loop_and_know_the_time(lamp: Rig) -> None:
    found = fit_proxies(lamp)
    ball = Sphere((0, 0, 0), 0.1, Waypoints((0.0, 1.0), ((0.0, 1.0, 0.0), (0.0, 3.0, 0.0))))
    frames = found.frames.repeat(3, 1, 1, 1)
    frames[:, :, 0, 3] += torch.tensor([0.0, 0.5, 1.0], dtype=torch.float64)[:, None]
    time = torch.tensor([0.0, 0.5, 1.0], dtype=torch.float64)
    batch = found.clearance(ball, frames, time)
    assert batch.shape == (3, 4)
    for k in range(3):
        torch.testing.assert_close(batch[k], found.clearance(ball, frames[k], time[k]))
    assert not torch.allclose(batch, found.clearance(ball, frames))


def test_clearance_has_the_gradient_of_its_differences(lamp: Rig) -> None:
    found = fit_proxies(lamp)
    ball = Sphere((0.4, 0.35, 0.1), 0.02)
    shift = torch.tensor([0.01, -0.02, 0.03], dtype=torch.float64, requires_grad=True)

    def moved(offset: torch.Tensor) -> torch.Tensor:
        frames = found.frames.clone()
        frames[:, :3, 3] = frames[:, :3, 3] + offset
        return found.clearance(ball, frames)

    assert torch.autograd.gradcheck(moved, (shift,))


def test_a_persons_body_has_the_radii_of_their_limbs(person: Rig) -> None:
    body = fit_body(person, NAMES)
    radius = {f"{HUMANML3D.names[c.a]}-{HUMANML3D.names[c.b]}": c.radius for c in body.capsules}
    assert radius["left_hip-left_knee"] == pytest.approx(0.075, abs=1e-3)
    assert radius["right_elbow-right_wrist"] == pytest.approx(0.04, abs=1e-3)
    assert radius["spine1-spine2"] == pytest.approx(0.13, abs=2e-3)
    assert tuple((c.a, c.b) for c in body.capsules) == HUMANML3D.bones
    assert [s.joint for s in body.spheres[:22]] == list(range(22))
    ground = person.triangles[..., 1].min()
    joints = torch.from_numpy(standing())
    assert body.sole_offset == pytest.approx(joints[[10, 11], 1].min().item() - ground)
    points = body.points_of(joints)
    assert (points[:, 1] - body.radii(points) - ground).min() > -1e-6  # nothing below the soles
    assert body.points(Motion(joints[None].repeat(3, 1, 1)))[0].shape == (3, body.count, 3)


def test_a_body_covers_its_person_but_for_what_it_says(person: Rig) -> None:
    body = fit_body(person, NAMES)
    said = float(body.source.rpartition(" mm")[0].rpartition(" ")[2]) / 1000
    assert "foot" in body.source  # feet reach further than their joints; nothing else does
    joints = torch.from_numpy(standing())
    points, radii = body.points_of(joints).numpy(), body.radii(joints).numpy()
    corners = np.concatenate([part.placed for part in person.parts if "foot" not in part.link])
    away = np.linalg.norm(corners[:, None] - points, axis=2) - radii
    slack = body.radii().max().item() * (1 - math.sqrt(0.75))  # dents between samples a radius apart
    assert away.min(axis=1).max() < max(said, slack)
    heads = next(part for part in person.parts if part.link == "head").placed
    head = [k for k, owner in enumerate(body.owners) if owner == "head"]
    assert (np.linalg.norm(heads[:, None] - points[head], axis=2) - radii[head]).min(axis=1).max() < 0.02


def test_joints_that_a_character_lacks_are_placed_between_others(person: Rig) -> None:
    fewer = {name: name for name in HUMANML3D.names if name not in PLACED}
    body = fit_body(person, fewer)
    thick = [c.radius for c in body.capsules]
    assert min(thick) > 0.01 and max(thick) < 0.25
    with pytest.raises(UserError, match="stated for left_knee"):
        fit_body(person, {name: name for name in HUMANML3D.names if name != "left_knee"})
    with pytest.raises(UserError, match="did you mean 'left_knee'"):
        fit_body(person, {**NAMES, "left_knee": "left_kne"})


def test_asking_for_nothing_is_told(lamp: Rig) -> None:
    with pytest.raises(UserError, match="0 capsules"):
        fit_proxies(lamp, capsules=0)
    with pytest.raises(UserError, match=r"coverage is 0\.2"):
        fit_proxies(lamp, 0.2)


def test_volumes_agree_with_trimesh(lamp: Rig) -> None:
    for part, found in zip(lamp.parts, fit_proxies(lamp).parts, strict=True):
        assert found.inside == pytest.approx(abs(trimesh.Trimesh(part.vertices, part.faces).volume), rel=1e-6)


def test_a_body_has_the_lengths_of_its_person_whatever_they_rest_in(tmp_path: Path) -> None:
    place = other_person(legs=0.8, arms=0.9, trunk=0.75, lean=0.9)
    body = fit_body(read_rig(humanoid(place=place).save(tmp_path / "small.glb")), NAMES)
    bones = [(j, np.linalg.norm(place[j] - place[p])) for p, j in HUMANML3D.bones]
    np.testing.assert_allclose(
        [body.skeleton.bone_lengths[j] for j, _ in bones], [size for _, size in bones], atol=2e-6
    )
    assert np.sign(body.skeleton.offsets).tolist()[18] == [1, 0, 0]  # arms that hang at rest are stretched out
    assert body.size == pytest.approx(0.8, abs=0.03) and body.sole_offset == pytest.approx(0.025, abs=2e-3)
    at = torch.einsum("mj,jd->md", body._samples.weights, torch.from_numpy(place))
    assert (at[:, 1] - body.radii(at)).min() > -1e-3  # nothing reaches below the soles


def test_joints_in_one_place_are_no_bone(tmp_path: Path) -> None:
    rig = read_rig(humanoid(place=standing()).save(tmp_path / "person.glb"))
    frames = rig.frames.copy()
    frames[rig.index("spine2")] = frames[rig.index("spine1")]
    with pytest.raises(UserError, match="spine1 and spine2 of 'person' lie in one place"):
        fit_body(replace(rig, frames=frames), NAMES)


def test_bodies_no_motion_is_made_for_are_told_and_old_ones_stay_adults(person: Rig, tmp_path: Path) -> None:
    found = fit_proxies(person, joints=NAMES)
    assert found.body is not None
    replace(found, body=found.body.scaled(3.0)).save(tmp_path / "giant.json")
    with pytest.raises(UserError, match=r"legs of 2\.\d+ m; motions are made for legs of 0\.37 to 1\.49 m"):
        load_body(tmp_path / "giant.json")
    replace(found, body=found.body.scaled(0.8)).save(tmp_path / "new.json")
    old = json.loads((tmp_path / "new.json").read_text())
    assert load_body(tmp_path / "new.json").size == pytest.approx(0.8 * found.body.size)
    (tmp_path / "old.json").write_text(json.dumps({**old, "format": "scenectl body 1"}))
    assert load_body(tmp_path / "old.json").skeleton == HUMANML3D
