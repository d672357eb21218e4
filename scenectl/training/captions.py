"""Text features of captions, for networks that learn from motions with their sentences."""

from __future__ import annotations

import torch
from jaxtyping import Int
from torch import Tensor, nn

from scenectl.data.clips import ClipSet
from scenectl.networks.text import TextEncoder, TextFeatures


class Captions:
    """Text features of every caption, encoded once."""

    def __init__(self, data: ClipSet, encoder: TextEncoder) -> None:
        texts = sorted({text for captions in data.captions for text in captions})
        index = {text: i for i, text in enumerate(texts)}
        self.of_clip = [[index[text] for text in captions] for captions in data.captions]
        parts = [encoder.encode(texts[i : i + 64]) for i in range(0, len(texts), 64)]
        self.sentence = torch.cat([p.sentence for p in parts]).cpu()
        # Without padding: a large data set's captions, all as long as the longest one, would fill the memory.
        self.words = [row[mask].cpu() for p in parts for row, mask in zip(p.words, p.mask, strict=True)]

    def draw(self, clips: Int[Tensor, " B"], generator: torch.Generator) -> TextFeatures:
        """A random caption of each clip, on the CPU (`Placement.text` moves it)."""
        uniform = torch.rand(len(clips), generator=generator).tolist()
        rows = torch.tensor(
            [self.of_clip[c][int(u * len(self.of_clip[c]))] for c, u in zip(clips.tolist(), uniform, strict=True)]
        )
        chosen = [self.words[row] for row in rows.tolist()]
        lengths = torch.tensor([len(words) for words in chosen])
        words = nn.utils.rnn.pad_sequence(chosen, batch_first=True)
        return TextFeatures(self.sentence[rows], words, torch.arange(words.shape[1]) < lengths[:, None])
