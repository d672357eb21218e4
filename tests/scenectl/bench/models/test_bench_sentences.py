"""Sentences of several acts: a classifier of pace, a generator that listens, and one that does not."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import given, settings, strategies as st
from torch import Tensor

from scenectl.bench.models.asked import SENTENCES, load_asked
from scenectl.bench.models.sentences import Seen, bench_sentences, in_order, in_time, look
from scenectl.data.features import joints_to_features
from scenectl.evaluation.kinds import WINDOWS, KindClassifier
from scenectl.generators.base import Draft
from scenectl.generators.prompts import Prompts
from scenectl.generators.spec import Spec
from scenes.errors import UserError
from scenes.motion.motion import Motion, Pose2D
from tests.scenectl.small import walk
from tests.scenectl.tiny import TinyGenerator
from tests.scenectl.training.folder import write_folder

FILE = """
[kinds]
walk = ["walk"]
run = ["run"]
stand = ["idle"]

[[sentence]]
text = "a person walks, then runs"
seconds = 6.0
acts = ["walk", "run"]

[[sentence]]
text = "a person runs and then stands"
seconds = 6.0
acts = ["run", "stand"]

[[timeline]]
seconds = 9.0
part = [
    { text = "a person runs", begin = 0.0, end = 3.0, act = "run" },
    { text = "a person walks", begin = 3.0, end = 6.0, act = "walk" },
    { text = "a person stands", begin = 6.0, end = 9.0, act = "stand" },
]
"""
SPEED = {"stands": 0.0, "walks": 1.0, "runs": 3.0}


class Pace(KindClassifier):
    """Tells kinds by the speed of the pelvis over the ground."""

    def __init__(self) -> None:
        super().__init__(["walk", "run", "idle", "lie"], 8, 1)

    def predict(self, motions: Sequence[Tensor]) -> list[str]:
        speeds = [20 * float(rows[:, 1:3].norm(dim=-1).mean()) for rows in motions]
        return ["idle" if speed < 0.5 else "walk" if speed < 2.0 else "run" for speed in speeds]


class Listening(TinyGenerator):
    """A statue that slides as fast as each sentence says, words in one sentence sharing its time."""

    spec = Spec(20.0, 0.5, 60.0, 9.8, frozenset({"sentences"}))

    def generate(self, prompts: Prompts | str, seconds: float, start: Pose2D, *, samples: int = 1, **_: Any) -> Draft:
        frames = round(20 * seconds)
        speed = torch.zeros(frames)
        for prompt in Prompts.of(prompts).sentences:
            begin = round(20 * prompt.begin)
            words = [word.strip(",") for word in prompt.text.split() if word.strip(",") in SPEED]
            end = frames if prompt.end is None else round(20 * prompt.end)
            for i, word in enumerate(words):
                speed[begin + (end - begin) * i // len(words) : end] = SPEED[word]
        joints = TinyGenerator().generate("x", seconds, start).motion.joints[0] * 1.0
        joints[:, :, 2] += (speed / 20).cumsum(0)[:, None] - 0.5 * torch.arange(frames)[:, None] / 20
        return Draft(Motion(joints.expand(samples, -1, -1, -1)))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "asked.toml").write_text(FILE)
    return tmp_path / "asked.toml"


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded walk and a recorded run; nobody stands."""
    clips = {"walk": walk(90, 1.0), "run": walk(90, 3.0)}
    about = {name: {"split": "test", "label": name} for name in clips}
    return write_folder(tmp_path_factory.mktemp("data"), {name: (clips[name], about[name]) for name in clips})


def test_who_listens_is_recognised_and_who_does_not_is_not(file: Path, data: Path) -> None:
    result = bench_sentences(Listening(), Pace(), data, file, samples=1)
    json.dumps(result)
    summary = result["summary"]
    assert summary["sentences"] == {"generated": 1.0, "recorded": 1.0}
    assert summary["sentences_by_chance"]["generated"] == 0.0
    assert summary["timeline_parts"] == {"generated": 1.0, "recorded": None}  # nobody was recorded standing
    assert summary["motions"] == {"generated": 3, "recorded": 1}
    assert summary["seam_ratio"] is None or summary["seam_ratio"] > 1.2  # its speed jumps
    assert [row["met"] for row in result["criteria"]] == [True, True, False]
    deaf = bench_sentences(TinyGenerator(), Pace(), data, file, samples=2)
    assert deaf["summary"]["sentences"]["generated"] == 0.0 and deaf["summary"]["timelines_left_out"] == 1
    assert [row["met"] for row in deaf["criteria"]] == [False, False, False]
    assert deaf["criteria"][1]["got"] is None


def test_windows_cover_a_motion_in_order() -> None:
    seen = look(joints_to_features(walk(101)), Pace())
    lengths = {round(window.end - window.begin, 6) for window in seen}
    assert lengths == set(WINDOWS) and min(w.begin for w in seen) == 0 and max(w.end for w in seen) == 5.0
    assert all(a.middle <= b.middle for a, b in zip(seen, seen[1:], strict=False))
    assert len(look(joints_to_features(walk(21)), Pace())) == 1  # shorter than any window


@settings(max_examples=50, deadline=None)
@given(st.lists(st.sampled_from("abc"), max_size=8), st.lists(st.sampled_from("abc"), min_size=1, max_size=4))
def test_acts_are_in_order_as_letters_in_a_word(word: list[str], wanted: list[str]) -> None:
    seen = [Seen(float(i), i + 2.0, kind) for i, kind in enumerate(word)]
    letters = iter(word)
    assert in_order(seen, [[act] for act in wanted]) == all(act in letters for act in wanted)


def test_windows_that_begin_together_do_not_follow_one_another() -> None:
    seen = [Seen(0.0, 2.0, "a"), Seen(0.2, 1.8, "b")]
    assert not in_order(seen, [["a"], ["b"]]) and in_order(seen, [["a", "b"]])


def test_an_act_in_its_time_lies_within_it_but_for_a_seam() -> None:
    seen = [Seen(1.0, 3.0, "a")]
    assert in_time(seen, ["a"], 1.25, 2.75) and not in_time(seen, ["a"], 1.3, 3.0)
    assert not in_time(seen, ["b"], 1.0, 3.0)


def test_the_file_that_ships_asks_for_what_the_issue_wants() -> None:
    asked = load_asked()
    assert len(asked.sentence) == 50 and {len(each.acts) for each in asked.sentence} == {2, 3}
    assert len({each.text for each in asked.sentence}) == 50
    assert len(asked.timeline) >= 10 and all(len(line.part) == 4 and line.seconds == 12 for line in asked.timeline)
    assert SENTENCES.name == "sentences.toml" and all(act in str(asked.acts) for act in asked.kinds)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('acts = ["walk", "run"]', 'acts = ["walk", "runn"]', "act 'runn' is not in .kinds.; did you mean 'run'"),
        ("end = 3.0", "end = 1.0", "last 1.6 s at least"),
        ("begin = 3.0", "begin = 2.0", "parts follow one another"),
        ("seconds = 9.0", "seconds = 8.0", "ends at 9 s, after"),
        ("seconds = 6.0\nacts", "second = 6.0\nacts", "unknown key 'second'"),
        ("[kinds]", "[kinds", "TOML"),
    ],
)
def test_a_wrong_file_is_answered_in_a_sentence(file: Path, old: str, new: str, said: str) -> None:
    file.write_text(FILE.replace(old, new, 1))
    with pytest.raises(UserError, match=said):
        load_asked(file)


def test_acts_that_the_classifier_never_heard_of_are_refused(file: Path, data: Path) -> None:
    file.write_text(FILE.replace('stand = ["idle"]', 'stand = ["levitate"]'))
    with pytest.raises(UserError, match=r"knows no kind of act 'stand' \(levitate\); it knows walk"):
        bench_sentences(Listening(), Pace(), data, file)
