"""The verdict on walks that are believable, and on what is made of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from scenectl.bench.studies.absurdities import ABSURDITIES
from scenectl.generators.prompts import Prompt, Prompts
from scenectl.measures.believability.checks import CHECKS
from scenectl.measures.believability.judge import Judge, limit_of
from scenectl.measures.believability.limits import LIMITS
from scenectl.measures.believability.verdict import Verdict
from scenectl.measures.metrics import Scorer
from scenes.body.body import DEFAULT_BODY
from scenes.mesh.primitives import Box, Sphere
from scenes.motion.bones import standing_pose
from scenes.motion.headings import turned
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid
from scenes.motion.skeleton import HUMANML3D
from scenes.motion.waypoints import Waypoints
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import Scene
from tests.scenectl.small import walk

FLOOR = Scene.empty()


def walker(frames: int = 80, speed: float = 1.2) -> Motion:
    """A walk with its soles on the floor."""
    return grounded(Motion(walk(frames, speed).double()))


def grounded(motion: Motion) -> Motion:
    a, b, radius, _ = DEFAULT_BODY.segments(motion)
    low = (torch.minimum(a[..., 1], b[..., 1]) - radius).amin()
    return moved(motion, motion.joints.new_tensor([0.0, -float(low), 0.0]))


def stander(frames: int = 60) -> Motion:
    """A person who stands and sways."""
    joints = standing_pose(HUMANML3D)
    joints[:, 2] -= 0.04
    height = (joints[:, 1:2] - joints[:, 1].min()) / 1.5
    sway = 0.02 * torch.sin(torch.arange(frames) / 3.0).double()
    return grounded(rigid(Motion(joints + height * sway[:, None, None])))


def moved(motion: Motion, by: Tensor) -> Motion:
    """The motion shifted, by one vector or one for each frame."""
    return replace(motion, joints=motion.joints + (by if by.ndim == 1 else by[:, None]))


def up(heights: Tensor) -> Tensor:
    return torch.stack([torch.zeros_like(heights), heights, torch.zeros_like(heights)], dim=-1)


def judged(motion: Motion, scene: Scene = FLOOR, prompt: Prompts | str = "") -> Verdict:
    return Judge(Scorer(scene), prompt).verdict(motion)


def checks(verdict: Verdict) -> set[str]:
    return {finding.check for finding in verdict.findings}


@pytest.mark.parametrize("heading", [0.0, 1.0, 4.0])
def test_a_walk_is_believable_wherever_it_goes(heading: float) -> None:
    motion = walker()
    there = replace(motion, joints=turned(motion.joints, torch.tensor(heading).double()) + torch.tensor([30.0, 0, -7]))
    verdict = judged(there, prompt="a person walks forward")
    assert verdict.believable and verdict.sentence == "believable", verdict.sentence
    assert set(verdict.figures) == {check.key for check in CHECKS}


@pytest.mark.parametrize("name", [name for name in ABSURDITIES if name != "twice the speed"])
@pytest.mark.parametrize("seed", (0, 2, 3))  # 1 leans along the walk, 10 cm off what supports: recorded people do so
def test_what_nobody_does_is_called_by_its_name(name: str, seed: int) -> None:
    made = ABSURDITIES[name].make(walker(100), torch.Generator().manual_seed(seed))
    assert made is not None
    verdict = judged(*made)
    assert verdict.findings[0].check in ABSURDITIES[name].right, verdict.sentence


@pytest.mark.parametrize("fps", [30.0, 60.0, 100.0])
@pytest.mark.parametrize("name", ["", "sliding 0.3 m/s", "teleported 0.3 m", "frozen 1 s in a walk", "lifted 5 cm"])
def test_a_verdict_does_not_depend_on_the_rate_of_the_file(fps: float, name: str) -> None:
    from scipy.interpolate import interp1d

    motion = walker()
    if name:
        made = ABSURDITIES[name].make(motion, torch.Generator().manual_seed(2))
        assert made is not None
        motion = made[0]
    times = np.arange(motion.frames) / 20
    kind = "linear" if name else "cubic"
    joints = interp1d(times, motion.joints.numpy(), kind, axis=0)(np.arange(0, times[-1], 1 / fps))
    motion = rigid(Motion(torch.from_numpy(joints), fps=fps))
    verdict = judged(motion if name else grounded(motion))
    if not name:
        assert verdict.believable, verdict.sentence
    else:
        assert verdict.findings[0].check in ABSURDITIES[name].right, verdict.sentence


def test_padding_counts_for_nothing_and_times_are_the_tasks() -> None:
    motion = walker()
    joints = torch.cat([motion.joints, torch.zeros(30, 22, 3).double()])
    padded = Motion(joints, torch.arange(110) < 80, t0=7.0)
    assert judged(padded).figures == pytest.approx(judged(motion).figures)
    jumped, _ = ABSURDITIES["teleported 0.3 m"].make(motion, torch.Generator().manual_seed(0))  # type: ignore[misc]
    early, late = judged(jumped).findings[0], judged(replace(jumped, t0=7.0)).findings[0]
    assert early.at_s is not None and late.at_s == pytest.approx(early.at_s + 7.0)


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 5, 6, 9])
def test_checks_that_need_more_frames_are_left_out(frames: int) -> None:
    verdict = judged(Motion(walker().joints[20 : 20 + frames]), prompt="a person walks")
    assert verdict.believable, verdict.sentence
    assert verdict.figures["tempo_times"] is None and verdict.figures["bones_m"] is not None
    assert set(Judge(Scorer(FLOOR)).series(Motion(walker().joints[:frames]))) == {
        "clearance_m",
        "speed_m_per_s",
        "support",
    }


def test_known_depths_are_not_computed_again(monkeypatch: pytest.MonkeyPatch) -> None:
    scorer, motion = Scorer(FLOOR), walker(40)
    depths = scorer.depths(motion)
    expected = Judge(scorer).verdict(motion).as_dict()
    monkeypatch.setattr(Scorer, "depths", lambda *_: pytest.fail("computed again"))
    assert Judge(scorer).verdict(motion, depths).as_dict() == expected
    assert Judge(scorer).series(motion, depths)["support"]


def test_what_is_touched_is_named_and_what_is_exempted_is_told() -> None:
    motion = walker(40)
    hand = motion.joint("left_wrist")[20].tolist()
    scene = Scene(primitives=[Box((hand[0], hand[1], hand[2] + 0.5), (0.1, 0.1, 1.0))], floor=0.0)
    verdict = judged(motion, scene)
    assert verdict.findings[0].check == "penetration" and "in the box at " in verdict.sentence
    arm = ("left_elbow", "left_wrist", "left_hip", "left_knee", "left_ankle")
    free = Judge(Scorer(scene), exemptions=((arm, None),)).verdict(motion)
    assert (free.figures["penetration_m"] or 0.0) < 0.01 and not checks(free) & {"penetration", "crossing"}
    assert any("left forearm, exempted, " in sentence and "in the box" in sentence for sentence in free.exempted)
    elsewhen = Judge(Scorer(scene), exemptions=((arm, ((0.0, 0.2),)),)).verdict(motion)
    assert "penetration" in checks(elsewhen)
    sunk = judged(moved(motion, torch.tensor([0.0, -0.04, 0.0]).double()))
    assert sunk.findings[0].check == "penetration" and "deep in the floor" in sunk.sentence


@pytest.mark.parametrize("thick", [0.01, 0.05])
@pytest.mark.parametrize("meshed", [False, True])
def test_a_wall_between_two_frames_is_crossed(thick: float, meshed: bool) -> None:
    motion = stander(10)
    steps = torch.zeros(10, 3).double()
    steps[5:, 2] = 1.6
    through = moved(motion, steps)
    box = Box((0.0, 1.2, 0.8), (4.0, 2.4, thick))
    scene = Scene([box.mesh()], floor=0.0, cache=None, resolution=32) if meshed else Scene(primitives=[box], floor=0.0)
    verdict = judged(through, scene)
    assert "crossing" in checks(verdict) and "penetration" not in checks(verdict)
    crossed = next(finding for finding in verdict.findings if finding.check == "crossing")
    assert 0.2 < (crossed.at_s or 0.0) < 0.25 and "between frames" in crossed.sentence
    beside = Scene(primitives=[Box((0.0, 1.2, 2.6), (4.0, 2.4, thick))], floor=0.0)
    assert "crossing" not in checks(judged(through, beside))


def test_leaving_the_free_space_is_called() -> None:
    scorer, motion = Scorer(FLOOR), walker(40)
    depths = scorer.depths(motion)
    beyond = np.where(np.arange(40) > 30, 0.4, 0.0)
    verdict = Judge(scorer).verdict(motion, replace(depths, beyond=beyond))
    assert verdict.findings[0].check == "left_free_space" and "0.40 m outside" in verdict.sentence


def test_falling_freely_needs_no_support_and_rising_on_nothing_does() -> None:
    time = torch.arange(40).double() / 20
    jump = torch.where((time > 0.5) & (time < 1.0), 9.81 / 2 * (time - 0.5) * (1.0 - time), 0.0)
    assert not {name for name in checks(judged(moved(stander(40), up(jump)))) if name.startswith("unsupported")}
    climb = 0.35 * ((torch.arange(80).double() / 20 - 1.0) / 0.3).clamp(0, 1)
    risen = judged(moved(walker(), up(climb)))
    assert risen.findings[0].check.startswith("unsupported") and "no free fall" in risen.sentence
    beside = Scene(primitives=[Box((3.0, 0.35, 2.0), (2.0, 0.7, 6.0))], floor=0.0)
    assert any(name.startswith("unsupported") for name in checks(judged(moved(walker(), up(climb)), beside)))


def test_a_platform_carries() -> None:
    box = Box((0.0, 0.25, 0.0), (2.0, 0.5, 2.0))
    standing = moved(stander(), torch.tensor([0.0, 0.5, 0.0]).double())
    found = checks(judged(standing, Scene(primitives=[box], floor=0.0)))
    assert not found & {"unsupported_0.7s", "unsupported_3s"}
    assert "unsupported_3s" in checks(judged(standing))


@pytest.mark.parametrize("height", [0.0, 0.04, 0.08])
def test_feet_slide_at_any_height_below_ten_centimetres(height: float) -> None:
    motion = moved(walker(), torch.tensor([0.0, height, 0.0]).double())
    drift = torch.zeros(80, 3).double()
    drift[:, 0] = 0.3 * torch.arange(80) / 20
    assert "sliding_2s" in checks(judged(moved(motion, drift)))
    assert not {name for name in checks(judged(motion)) if name.startswith("sliding")}


def test_bones_stay_as_long_as_they_are_whatever_their_proportions() -> None:
    motion = walker()
    longer = motion.joints.clone()
    longer[40:42, 15] += 0.004 * torch.nn.functional.normalize(longer[40:42, 15] - longer[40:42, 12], dim=-1)
    finding = judged(replace(motion, joints=longer)).findings[0]
    assert finding.check == "bones" and finding.sentence == "head 4 mm longer than at other times at 2.00 s"
    assert finding.at_s == pytest.approx(2.0)


def test_bones_are_as_long_as_the_bodys_own_size_has_them() -> None:
    motion = walker()
    tall = grounded(replace(motion, joints=1.15 * motion.joints))
    assert not {"bones", "proportions"} & set(checks(judged(tall)))
    joints = motion.joints.clone()
    for elbow, wrist in ((18, 20), (19, 21)):
        joints[:, wrist] = joints[:, elbow] + (joints[:, wrist] - joints[:, elbow]) * (1 - 0.15 / 0.268)
    verdict = judged(replace(motion, joints=joints))
    assert verdict.findings[0].check == "proportions" and "forearm 15 cm shorter than it should be" in verdict.sentence


def test_knees_bend_one_way_however_the_trunk_leans() -> None:
    motion = stander()
    joints = motion.joints.clone()
    joints[:, [4, 5], 2] -= 0.15  # knees behind the line from hip to ankle
    assert "joints" in checks(judged(replace(motion, joints=joints)))
    squat = motion.joints.clone()
    squat[:, [4, 5], 2] += 0.15
    assert "joints" not in checks(judged(replace(motion, joints=squat)))
    trunk = [3, 6, 9, *range(12, 22)]
    bow = squat.clone()
    offset = squat[:, trunk] - squat[:, :1]
    x, y, z = offset.unbind(-1)
    angle = math.radians(130)
    bow[:, trunk] = squat[:, :1] + torch.stack(
        [x, y * math.cos(angle) - z * math.sin(angle), y * math.sin(angle) + z * math.cos(angle)], dim=-1
    )
    assert "joints" not in checks(judged(replace(motion, joints=bow)))


def test_speeds_accelerations_and_turns_have_limits() -> None:
    def fast(speed: float) -> Motion:
        drift = torch.zeros(80, 3).double()
        drift[:, 2] = speed * torch.arange(80) / 20
        return moved(stander(80), drift)

    assert "speed" in checks(judged(fast(8.0))) and "speed" not in checks(judged(fast(2.0)))

    def spun(turns: float) -> Motion:
        motion = stander(80)
        return replace(motion, joints=turned(motion.joints, (2 * math.pi * turns * motion.times.double())[:, None]))

    assert "turning" in checks(judged(spun(2.0))) and "turning" not in checks(judged(spun(0.5)))

    def waved(size: float) -> Motion:
        motion = stander(80)
        joints = motion.joints.clone()
        joints[:, 20, 0] += size * torch.sin(2 * math.pi * 3.3 * motion.times.double())
        return replace(motion, joints=joints)

    assert {"joint_speed", "acceleration"} <= checks(judged(waved(0.8)))
    assert not {"joint_speed", "acceleration"} & checks(judged(waved(0.1)))


def test_standing_still_is_called_where_the_sentence_moves() -> None:
    verdict = judged(stander(), prompt="a person walks forward")
    assert verdict.findings[0].check == "standing_still" and "where the sentence moves" in verdict.sentence
    for prompt in ("a person waves", "a person walks in place", "", "the walker stands still"):
        assert "standing_still" not in checks(judged(stander(), prompt=prompt)), prompt
    assert "standing_still" not in checks(judged(walker(), prompt="a person walks forward"))


def test_standing_still_is_called_in_the_time_of_the_sentence_that_moves() -> None:
    def told(*sentences: tuple[str, float]) -> Prompts:
        return Prompts(tuple(Prompt(*each) for each in sentences))

    motion = walker()
    joints = motion.joints.clone()
    half = motion.frames // 2
    joints[half:] = joints[half]  # walks, then stands
    motion, then = replace(motion, joints=joints), half / motion.fps
    waits = told(("a person walks forward", 0.0), ("a person waits", then))
    assert "standing_still" not in checks(judged(motion, prompt=waits))
    walks_on = told(("a person walks forward", 0.0), ("a person walks on", then))
    assert "standing_still" in checks(judged(motion, prompt=walks_on))
    assert "standing_still" in checks(judged(motion, prompt=told(("a person waits", 0.0), ("he walks", then))))


def test_people_who_stand_sway_and_statues_do_not() -> None:
    statue = Motion(stander().joints[:1].expand(60, -1, -1))
    assert judged(statue).findings[0].check == "frozen"
    assert "frozen" not in checks(judged(stander()))


def test_what_explains_others_comes_first() -> None:
    made = ABSURDITIES["a bone 10 cm longer"].make(walker(), torch.Generator().manual_seed(5))
    assert made is not None
    deep = moved(made[0], torch.tensor([0.0, -0.5, 0.0]).double())
    verdict = judged(deep)
    assert [finding.check for finding in verdict.findings][:1] == ["proportions"] and "penetration" in checks(verdict)
    rest = [finding for finding in verdict.findings if finding.check in ("penetration", "balance", "sliding_2s")]
    ratios = [finding.value / finding.limit for finding in rest]
    assert ratios == sorted(ratios, reverse=True)


def test_series_tell_every_frame() -> None:
    motion = walker(40)
    scene = Scene(primitives=[Box((2.0, 1.0, 0.0), (0.2, 2.0, 6.0))], floor=0.0)
    padded = replace(motion, valid=torch.arange(40) < 30)
    series = Judge(Scorer(scene)).series(padded)
    clearance = series["clearance_m"]
    assert isinstance(clearance, dict) and {"pelvis", "left_hip-left_knee", "right_palm"} <= set(clearance)
    expected = Scorer(scene).depths(padded).clearance
    nearest = [min(v[t] for v in clearance.values() if v[t] is not None) for t in range(30)]  # type: ignore[type-var]
    assert nearest == pytest.approx(expected[:30].tolist(), abs=1e-3)
    assert all(values[35] is None for values in clearance.values())
    speed, support = series["speed_m_per_s"], series["support"]
    assert isinstance(speed, list) and speed[:30] == pytest.approx([1.2] * 30, abs=0.05) and speed[35] is None
    assert isinstance(support, list) and set(support[:30]) <= {"left_foot", "right_foot", "both"}
    assert {"left_foot", "right_foot"} <= set(support) and support[35] == "none"
    assert set(Judge(Scorer(FLOOR)).series(moved(motion, torch.tensor([0.0, 0.3, 0.0]).double()))["support"]) == {
        "none"
    }


def test_every_limit_has_a_value_and_a_source() -> None:
    for check in CHECKS:
        assert limit_of(check) is not None, check.name
        assert check.limit is None or check.source
    assert set(LIMITS.values) == {check.name for check in CHECKS if check.limit is None}
    assert {"command", "source", "clips", "sources"} <= set(LIMITS.about)


def test_skeleton_has_all_that_mass_needs() -> None:
    from scenectl.measures.believability.mass import shares

    weights = shares(HUMANML3D)
    assert weights.sum() == pytest.approx(1.0)
    joints = stander(1).joints[0].numpy()
    stature = joints[:, 1].max() + 0.17  # from where the skull begins to the crown
    assert 0.53 < (weights @ joints)[1] / stature < 0.59  # 0.55 to 0.57 for adults


def test_what_flies_through_a_person_between_two_frames_crosses() -> None:
    motion = stander(10)
    way = ((0.0, 1.0, -1.6), (0.0, 1.0, 1.6))
    thing = MovingObject(Box((0.0, 0.0, 0.0), (0.3, 0.3, 0.3)), Trajectory((0.2, 0.25), way), name="crate")
    ball = Sphere(way[0], 0.15, Waypoints((0.2, 0.25), way))
    for scene in (Scene(objects=[thing], floor=0.0), Scene(primitives=[ball], floor=0.0)):
        verdict = judged(motion, scene)
        assert "crossing" in checks(verdict) and "penetration" not in checks(verdict)
    beside = replace(thing, trajectory=thing.trajectory.moved((2.0, 0.0, 0.0)))
    assert "crossing" not in checks(judged(motion, Scene(objects=[beside], floor=0.0)))


@pytest.mark.parametrize("seconds", [0.7, 1.0, 2.0])
def test_a_hover_is_called_however_short_and_a_hop_is_not(seconds: float) -> None:
    time = torch.arange(80).double() / 20
    held = ((time >= 1.0) & (time < 1.0 + seconds)).double()
    found = checks(judged(moved(stander(80), up(0.09 * held))))
    assert "unsupported_0.7s" in found
    hop = torch.where((time > 1.0) & (time < 1.4), 9.81 / 2 * (time - 1.0) * (1.4 - time), 0.0)
    assert "unsupported_0.7s" not in checks(judged(moved(stander(80), up(hop))))


def test_a_leaning_body_is_off_balance_whatever_its_feet_do() -> None:
    made = ABSURDITIES["tilted 20 degrees"].make(walker(100), torch.Generator().manual_seed(3))
    assert made is not None
    drift = torch.zeros(100, 3).double()
    drift[:, 0] = torch.arange(100) / 20
    verdict = judged(moved(made[0], drift))
    assert "sliding_2s" in checks(verdict) and verdict.findings[0].check == "balance"
