"""What the evaluator of Guo et al. reads of a caption: word vectors and parts of speech (protocol 3.4).

Words of five lists have a class of their own, whatever their part of speech. Captions come with their words already
split, reduced to lemmas and tagged, as HumanML3D's text files hold them: another tagger's words are other words.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float, Int
from torch import Tensor

from scenectl.data.humanml3d import read_captions
from scenes.errors import UserError
from scenes.files import read_array, reading

WORD = 300
MOST_WORDS = 20
"""Words of a caption that are read; a start and an end are put around them."""

CLASSES = (
    *("VERB", "NOUN", "DET", "ADP", "NUM", "AUX", "PRON", "ADJ", "ADV"),
    *("location", "body", "object", "action", "description", "OTHER"),
)
"""Parts of speech and the five lists, in the order in which the network knows them."""

_LISTS = {
    "location": "left right clockwise counterclockwise anticlockwise forward back backward up down straight curve",
    "body": "arm chin foot feet face hand mouth leg waist eye knee shoulder thigh",
    "object": "stair dumbbell chair window floor car ball handrail baseball basketball",
    "action": "walk run swing pick bring kick put squat throw hop dance jump turn stumble stop sit lift lower raise "
    "wash stand kneel stroll rub bend balance flap jog shuffle lean rotate spin spread climb",
    "description": "slowly carefully fast careful slow quickly happy angry sad happily angrily sadly",
}
_LISTED = {word: name for name, words in _LISTS.items() for word in words.split()}
_START, _END, _UNKNOWN = "sos", "eos", "unk"

CONVERT = (
    "python -c \"import pickle; i = pickle.load(open('our_vab_idx.pkl', 'rb')); "
    "open('our_vab_words.txt', 'w', encoding='utf-8').write('\\n'.join(sorted(i, key=i.get)))\""
)
"""Makes the list of words from the published pickle, which we never open: run it on a file that you trust."""


@dataclass(frozen=True)
class Vocabulary:
    """GloVe vectors of the words that the evaluator was trained with.

    Attributes:
        vectors: one row a word, ``[V, 300]``.
        rows: row of each word.
    """

    vectors: Float[Tensor, "V 300"]
    rows: dict[str, int]

    @classmethod
    def read(cls, folder: Path) -> Vocabulary:
        """From ``our_vab_data.npy`` and ``our_vab_words.txt``, a word a line in the order of the rows.

        Raises:
            UserError: a file is missing or damaged, or they do not belong together.
        """
        words = folder / "our_vab_words.txt"
        vectors = read_floats(folder / "our_vab_data.npy", WORD, "[V, 300]")
        if not words.is_file():
            raise UserError(f"list of words '{words}' does not exist; make it in that folder: {CONVERT}")
        with reading(f"list of words '{words}'", f"make it again: {CONVERT}"):
            names = words.read_text(encoding="utf-8").splitlines()
        rows = {name: i for i, name in enumerate(names)}
        if len(rows) != len(vectors) or not {_START, _END, _UNKNOWN} <= rows.keys():
            raise UserError(
                f"list of words '{words}' holds {len(rows)} different words for {len(vectors)} vectors; it needs one "
                f"a line for each, with {_START}, {_END} and {_UNKNOWN} among them: {CONVERT}"
            )
        return cls(vectors, rows)

    def read_tokens(self, tokens: Sequence[str]) -> tuple[Float[Tensor, "L 300"], Int[Tensor, " L"]]:
        """Vectors and classes of tokens ``walk/VERB``, with the start and the end around the first 20 of them."""
        pairs = [(_START, "OTHER"), *(token.rpartition("/")[::2] for token in tokens[:MOST_WORDS]), (_END, "OTHER")]
        known = [(word, tag) if word in self.rows else (_UNKNOWN, "OTHER") for word, tag in pairs]
        classes = [_LISTED.get(word, tag if tag in CLASSES else "OTHER") for word, tag in known]
        rows = torch.tensor([self.rows[word] for word, _ in known])
        return self.vectors[rows], torch.tensor([CLASSES.index(name) for name in classes])


def read_tagged(folder: Path) -> dict[str, tuple[str, ...]]:
    """Tokens of each caption, in small letters, of HumanML3D's text files (lines ``caption#tokens#start#end``).

    Raises:
        UserError: the folder is missing or empty, or a file is damaged.
    """
    files = sorted(folder.glob("*.txt")) if folder.is_dir() else []
    if not files:
        raise UserError(f"folder '{folder}' holds no captions; put HumanML3D's folder 'texts' there, or a link to it")
    return {caption.text.lower(): caption.tokens for file in files for caption in read_captions(file)}


def tokens_of(caption: str, tagged: dict[str, tuple[str, ...]]) -> tuple[str, ...]:
    """A caption's tokens.

    Raises:
        UserError: the caption has none.
    """
    found = tagged.get(caption.strip().lower())
    if not found:
        raise UserError(
            f"caption '{caption}' has no tagged words in 'texts'; add a line "
            f"'{caption}#lemma/TAG lemma/TAG ..#0.0#0.0' (tags of spaCy's en_core_web_sm) to a file there"
        )
    return found


def read_floats(path: Path, size: int, layout: str) -> Tensor:
    """An array of finite floats whose last axis has a size.

    Raises:
        UserError: it is missing, damaged or something else.
    """
    array = read_array(path, "file", layout, "fetch it again, for the evaluator of Guo et al. needs it")
    if array.shape[-1] != size:
        raise UserError(f"file '{path}' is not an array of {layout} floats; it is not the evaluator's")
    return torch.from_numpy(array)
