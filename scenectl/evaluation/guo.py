"""The public text-to-motion evaluator of Guo et al. (CVPR 2022), for those who have its weights (protocol 3.4).

A folder holds, under their published names:

* ``finest.tar``: the weights (``text_mot_match/model``). It is a torch archive, read without running what it pickles;
* ``t2m_mean.npy`` and ``t2m_std.npy``: the normalisation the evaluator was trained with (``Comp_v6_KLD01/meta``),
  which is not HumanML3D's own;
* ``our_vab_data.npy`` and ``our_vab_words.txt``: GloVe vectors and their words, one a line. The words are published
  as a pickle, which we do not read: `guo_text.CONVERT` makes the list;
* ``texts``: HumanML3D's text files, which hold each caption's tagged words.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn.utils.rnn import pack_padded_sequence, pad_sequence

from scenectl.data.features import CONTACTS, FEATURES, GROUPS, POSITIONS, ROTATIONS, VELOCITIES
from scenectl.evaluation.guo_text import CLASSES, WORD, Vocabulary, read_floats, read_tagged, tokens_of
from scenectl.evaluation.motions import LONGEST, STRIDE, Padded
from scenes.errors import UserError
from scenes.files import reading

PARTS = ("movement_encoder", "motion_encoder", "text_encoder")
OUT = 512

HUMANML3D_STD = (0.012826, 0.016927, 0.153766, 0.122244, 0.299692, 0.019470, 0.355933)
"""HumanML3D's deviations, averaged within each of `GROUPS` as its Std.npy is."""
EMPHASIS = 25.0
"""The evaluator's deviations of root and contacts are this many times smaller than HumanML3D's."""
TOLERANCE = 0.1


class MovementEncoder(nn.Module):
    """Two strided convolutions: a movement for every four frames, from all features but the contacts."""

    def __init__(self) -> None:
        super().__init__()
        self.main = nn.Sequential(
            *(nn.Conv1d(CONTACTS.start, OUT, 4, 2, 1), nn.Dropout(0.2), nn.LeakyReLU(0.2)),
            *(nn.Conv1d(OUT, OUT, 4, 2, 1), nn.Dropout(0.2), nn.LeakyReLU(0.2)),
        )
        self.out_net = nn.Linear(OUT, OUT)

    def forward(self, features: Float[Tensor, "B T 263"]) -> Float[Tensor, "B T/4 512"]:
        moved: Tensor = self.main(features[..., : CONTACTS.start].transpose(1, 2))
        out: Tensor = self.out_net(moved.transpose(1, 2))
        return out


class BiGRU(nn.Module):
    """Both last states of a bidirectional GRU that starts from learnt ones, made one point."""

    def __init__(self, size: int, hidden: int) -> None:
        super().__init__()
        self.input_emb = nn.Linear(size, hidden)
        self.gru = nn.GRU(hidden, hidden, batch_first=True, bidirectional=True)
        self.output_net = nn.Sequential(
            nn.Linear(2 * hidden, hidden), nn.LayerNorm(hidden), nn.LeakyReLU(0.2), nn.Linear(hidden, OUT)
        )
        self.hidden = nn.Parameter(torch.randn(2, 1, hidden))

    def forward(self, rows: Float[Tensor, "B L n"], lengths: Int[Tensor, " B"]) -> Float[Tensor, "B 512"]:
        """Points in the order given: packing sorts by length, and what it sorts it puts back."""
        packed = pack_padded_sequence(self.input_emb(rows), lengths, batch_first=True, enforce_sorted=False)
        _, last = self.gru(packed, self.hidden.expand(-1, len(rows), -1).contiguous())
        out: Tensor = self.output_net(torch.cat([last[0], last[1]], dim=-1))
        return out


class TextEncoder(BiGRU):
    """Words are the sum of their GloVe vector and of one learnt for their part of speech."""

    def __init__(self) -> None:
        super().__init__(WORD, 512)
        self.pos_emb = nn.Linear(len(CLASSES), WORD)

    def embed(
        self, words: Float[Tensor, "B L 300"], classes: Int[Tensor, "B L"], lengths: Int[Tensor, " B"]
    ) -> Float[Tensor, "B 512"]:
        tags = F.one_hot(classes, len(CLASSES)).to(words)
        return self(words + self.pos_emb(tags), lengths)


class GuoNetwork(nn.Module):
    """The three encoders, with parameters named as published."""

    def __init__(self) -> None:
        super().__init__()
        self.movement_encoder = MovementEncoder()
        self.motion_encoder = BiGRU(OUT, 1024)
        self.text_encoder = TextEncoder()


@dataclass
class GuoEvaluator:
    """The frozen network, its normalisation and its words as an `Evaluator`."""

    network: GuoNetwork
    mean: Float[Tensor, "263"]
    std: Float[Tensor, "263"]
    vocabulary: Vocabulary
    tagged: dict[str, tuple[str, ...]]
    name: str = "Guo et al. (2022), public weights"

    def embed_motions(self, motions: Sequence[Float[Tensor, "_T 263"]]) -> Float[Tensor, "N 512"]:
        """One point for each motion of raw features, of at least four frames; longer ones are cut at 196.

        Zeros follow a motion up to frame 196, always, as in the data the network was trained on: its convolutions see
        a few of them, so that with less padding a motion's point would depend on which others share its batch.
        """
        return torch.cat([self._motions(motions[i : i + 64]) for i in range(0, len(motions), 64)])

    def _motions(self, motions: Sequence[Float[Tensor, "_T 263"]]) -> Float[Tensor, "B 512"]:
        batch = Padded.of(motions, LONGEST)
        rows = (batch.features - self.mean) / self.std * batch.mask(1)[..., None]
        rows = F.pad(rows, (0, 0, 0, LONGEST - rows.shape[1]))
        out: Tensor = self.network.motion_encoder(self.network.movement_encoder(rows), batch.lengths // STRIDE)
        return out

    def embed_texts(self, captions: Sequence[str]) -> Float[Tensor, "N 512"]:
        """One point for each caption; raises UserError for one whose tagged words are not in the folder."""
        read = [self.vocabulary.read_tokens(tokens_of(caption, self.tagged)) for caption in captions]
        return torch.cat([self._texts(read[i : i + 256]) for i in range(0, len(read), 256)])

    def _texts(self, read: Sequence[tuple[Tensor, Tensor]]) -> Float[Tensor, "B 512"]:
        words, classes = (pad_sequence(list(rows), batch_first=True) for rows in zip(*read, strict=True))
        return self.network.text_encoder.embed(words, classes, torch.tensor([len(rows) for rows, _ in read]))


def load_guo(folder: str | Path) -> GuoEvaluator:
    """The evaluator from a folder as the module describes it.

    Raises:
        UserError: a file is missing, damaged, of another network, or the normalisation is not the evaluator's.
    """
    folder = Path(folder)
    mean, std = (read_floats(folder / f"t2m_{name}.npy", FEATURES, "[263]") for name in ("mean", "std"))
    check_normalisation(std, folder / "t2m_std.npy")
    network = GuoNetwork().eval().requires_grad_(False)
    _fill(network, folder / "finest.tar")
    return GuoEvaluator(network, mean, std, Vocabulary.read(folder), read_tagged(folder / "texts"))


def check_normalisation(std: Float[Tensor, "263"], path: Path) -> None:
    """Refuse deviations other than the evaluator's: with HumanML3D's own, FID is a number without meaning.

    Raises:
        UserError: root and contacts are not divided by 25, or another group is not HumanML3D's.
    """
    smaller = torch.tensor([value / float(std[g].mean()) for g, value in zip(GROUPS, HUMANML3D_STD, strict=True)])
    wanted = torch.tensor([1.0 if g in (POSITIONS, ROTATIONS, VELOCITIES) else EMPHASIS for g in GROUPS])
    if bool(((smaller / wanted - 1).abs() < TOLERANCE).all()):
        return
    own = bool(((smaller - 1).abs() < TOLERANCE).all())
    what = "HumanML3D's own deviations" if own else "deviations of something else"
    raise UserError(
        f"'{path}' holds {what}, not the evaluator's, whose root and contacts are {EMPHASIS:g} times smaller than "
        "HumanML3D's; take mean and std from Comp_v6_KLD01/meta"
    )


def _fill(network: GuoNetwork, path: Path) -> None:
    """Read the published archive; `weights_only` lets it hold tensors and numbers, and run nothing."""
    if not path.is_file():
        raise UserError(f"weights '{path}' do not exist; fetch text_mot_match/model/finest.tar of Guo et al.")
    with reading(f"weights '{path}'", "they are no torch archive of plain tensors; fetch them again"):
        archive = torch.load(path, map_location="cpu", weights_only=True)
    with reading(f"weights '{path}'", "they are not those of the evaluator of Guo et al.; fetch them again"):
        for name in PARTS:
            network.get_submodule(name).load_state_dict(archive[name])
    if not all(bool(torch.isfinite(p).all()) for p in network.parameters()):
        raise UserError(f"weights '{path}' hold numbers that are not finite; fetch them again")
