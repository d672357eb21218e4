"""Captions of clips as text features."""

from __future__ import annotations

from pathlib import Path

import torch

from scenectl.data.clips import prepare
from scenectl.networks.text import TextFeatures
from scenectl.training.captions import Captions
from tests.scenectl.small import Words
from tests.scenectl.training.folder import walks


def test_captions_are_the_clips_own_and_all_get_their_turn(tmp_path: Path) -> None:
    clips = prepare(walks(tmp_path / "data"), ["train"], None, tmp_path, 0)
    clips.captions[1][:] = ["one", "two words"]
    captions = Captions(clips, Words())
    seen = set()
    for seed in range(12):
        got = captions.draw(torch.tensor([1, 0]), torch.Generator().manual_seed(seed))
        assert isinstance(got, TextFeatures) and got.words.shape[1] == int(got.mask.sum(-1).max())
        texts = {i: Words().encode([text]) for i, text in enumerate(clips.captions[1])}
        (chosen,) = (i for i, t in texts.items() if torch.allclose(got.sentence[0], t.sentence[0]))
        seen.add(chosen)
        length = int(got.mask[0].sum())
        torch.testing.assert_close(got.words[0, :length], texts[chosen].words[0])
        torch.testing.assert_close(got.sentence[1], Words().encode(clips.captions[0]).sentence[0])
    assert seen == {0, 1}
