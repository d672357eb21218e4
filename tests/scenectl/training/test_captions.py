"""Captions of clips as text features."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
import torch
from hypothesis import given, strategies as st

from scenectl.data.clips import ClipSet, Drawn, Told, prepare, told
from scenectl.data.corpus import Act, Clip
from scenectl.networks.text import TextFeatures, TimedText
from scenectl.training.captions import Captions, enough, sentences
from tests.scenectl.small import Words
from tests.scenectl.training.folder import walks


class Counting(Words):
    """Counts what it encodes."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def encode(self, prompts: list[str]) -> TextFeatures:
        self.texts += prompts
        return super().encode(prompts)


def clip_of(*lengths: int) -> Clip:
    """A clip whose acts are named by their number; none for one length."""
    edges = [sum(lengths[:i]) for i in range(len(lengths) + 1)]
    acts = tuple(Act(a, b, (f"act {i}.",)) for i, (a, b) in enumerate(zip(edges[:-1], edges[1:], strict=True)))
    joints = torch.zeros(edges[-1], 22, 3)
    return Clip("a", joints, ("all of it.",), "s", "train", "l", "free", True, acts if len(acts) > 1 else ())


def set_of(folder: Path) -> ClipSet:
    """Walks, the first of which shows three things in 50 frames."""
    clips = prepare(walks(folder / "data"), ["train"], None, folder, 0)
    clips.told[0][:] = told(clip_of(20, 20, 10))
    return clips


def texts_of(text: TimedText, row: int) -> list[tuple[str, float, float]]:
    """What a row says, found again among all that can be said."""
    known = {t: Words().encode([t]).sentence[0] for t in (*(f"act {i}." for i in range(3)), "all of it.")}
    found = []
    for i in range(int(text.owner[row].max()) + 1):
        near = [t for t, s in known.items() if torch.allclose(text.sentence[row, i], s, atol=2e-3)]
        found.append((near[0] if near else "run", float(text.begin[row, i]), float(text.end[row, i])))
    return found


def test_captions_are_the_clips_own_and_all_get_their_turn(tmp_path: Path) -> None:
    clips = prepare(walks(tmp_path / "data"), ["train"], None, tmp_path, 0)
    clips.captions[1][:] = ["one", "two words"]
    captions = Captions(clips, Words())
    seen = set()
    for seed in range(12):
        got = captions.of_clips(torch.tensor([1, 0]), torch.Generator().manual_seed(seed))
        assert isinstance(got, TimedText) and got.words.shape[1] == int((got.owner >= 0).sum(-1).max())
        texts = {i: Words().encode([text]) for i, text in enumerate(clips.captions[1])}
        (chosen,) = (i for i, t in texts.items() if torch.allclose(got.sentence[0, 0], t.sentence[0], atol=2e-3))
        seen.add(chosen)
        length = int((got.owner[0] == 0).sum())
        torch.testing.assert_close(got.words[0, :length], texts[chosen].words[0], atol=2e-3, rtol=2e-3)
        torch.testing.assert_close(
            got.sentence[1, 0], Words().encode(clips.captions[0]).sentence[0], atol=2e-3, rtol=2e-3
        )
        assert not got.begin.any() and got.end.isinf().all()
    assert seen == {0, 1}


def test_a_window_is_told_what_it_shows_in_one_sentence_or_act_by_act(tmp_path: Path) -> None:
    captions = Captions(set_of(tmp_path), Words())
    features = torch.zeros(3, 36, 263)
    windows = Drawn(
        features, torch.tensor([0, 0, 1]), torch.tensor([2, 14, 0])
    )  # of acts 0 and 1; of all three; a walk
    seen = set()
    for seed in range(16):
        text = captions.of_windows(windows, 4, torch.Generator().manual_seed(seed))
        first, second = texts_of(text, 0), texts_of(text, 1)
        assert first in ([("run", 0, 9)], [("act 0.", 0, 4.5), ("act 1.", 4.5, 9)])
        assert second in ([("run", 0, 9)], [("act 1.", 0, 6.5), ("act 2.", 6.5, 9)])  # 6 frames of the first are few
        assert len(texts_of(text, 2)) == 1
        seen |= {len(first), 10 * len(second)}
    assert seen == {1, 2, 10, 20}


@given(lengths=st.lists(st.integers(3, 60), min_size=1, max_size=5), at=st.floats(0, 1), seed=st.integers(0, 99))
def test_what_is_said_of_a_window_covers_it_and_is_of_acts_that_it_shows(
    lengths: list[int], at: float, seed: int
) -> None:
    clip = clip_of(*lengths)
    frames = min(36, clip.frames)
    offset = round(at * (clip.frames - frames))
    said = sentences(told(clip), offset, frames, random.Random(seed))
    assert said[0].begin == 0 and said[-1].end == frames
    assert all(a.end == b.begin and a.begin < a.end for a, b in zip(said[:-1], said[1:], strict=True))
    acts = [one for one in told(clip)[1:] if one.acts == 1] or told(clip)
    seen = [(act, min(act.end, offset + frames) - max(act.begin, offset)) for act in acts]
    assert sum(one.acts for one in said) == max(1, sum(n >= enough(act.end - act.begin) for act, n in seen))
    if len(said) > 1:
        assert [one.captions for one in said] == [act.captions for act, n in seen if n >= enough(act.end - act.begin)]


def test_a_clip_that_shows_one_thing_is_told_so(tmp_path: Path) -> None:
    one = [Told(0, 90, ["all of it."])]
    for seed in range(4):
        assert sentences(one, 20, 40, random.Random(seed)) == [Told(0, 40, ["all of it."])]


def test_texts_are_encoded_once_and_kept_for_all_runs(tmp_path: Path) -> None:
    clips, cache = set_of(tmp_path), tmp_path / "kept"
    encoder = Counting()
    first = Captions(clips, encoder, cache)
    texts = {text for stretches in clips.told for one in stretches for text in one.captions}
    assert sorted(encoder.texts) == sorted(texts)
    again = Counting()
    second = Captions(clips, again, cache)
    assert len(again.texts) == 1  # tried on one, to see whether it is the same encoder
    clips.told[1][0].captions.append("something new")
    more = Counting()
    third = Captions(clips, more, cache)
    assert more.texts[1:] == ["something new"]
    draw = (torch.arange(4), torch.Generator())
    got = [each.of_clips(draw[0], draw[1].manual_seed(3)) for each in (first, second)]
    assert torch.equal(got[0].sentence, got[1].sentence) and torch.equal(got[0].words, got[1].words)
    for text in (*texts, "something new"):
        torch.testing.assert_close(
            third._encoded.said(text).words, Words().encode([text]).words[0], atol=2e-3, rtol=2e-3
        )


@pytest.mark.parametrize("damage", ["cut", "other encoder", "empty"])
def test_what_was_kept_of_another_encoder_or_by_halves_is_made_anew(tmp_path: Path, damage: str) -> None:
    clips, encoder = set_of(tmp_path), Counting()
    Captions(clips, Words(), tmp_path)
    (path,) = tmp_path.glob("texts-*.safetensors")
    if damage == "other encoder":
        encoder.encode = lambda texts: Words().encode([text[::-1] for text in encoder.texts.extend(texts) or texts])  # type: ignore[method-assign]
    else:
        path.write_bytes(path.read_bytes()[: 200 if damage == "cut" else 0])
    Captions(clips, encoder, tmp_path)
    assert len(encoder.texts) > 5
