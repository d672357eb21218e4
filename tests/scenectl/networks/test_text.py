"""The text encoder agrees with the library it stands in for, is deterministic, and fails in one sentence."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from scenectl.networks.text import MINILM_PACKAGE, MiniLM, TextEncoder, load_text_encoder
from scenes.errors import UserError

PROMPTS = [
    "a person walks forward, then turns around.",
    "",
    "Drunk WALKING animation turning around",
    "café naïve ... 3.5 m/s!",
    "a person jumps " * 120,  # longer than the encoder reads
]


@pytest.fixture(scope="module")
def minilm() -> TextEncoder:
    pytest.importorskip(MINILM_PACKAGE)
    return load_text_encoder("minilm")


def test_minilm_agrees_with_sentence_transformers(minilm: TextEncoder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    library = pytest.importorskip("sentence_transformers")
    package = pytest.importorskip(MINILM_PACKAGE)
    reference = library.SentenceTransformer(str(package.get_model_path()), device="cpu")
    features = minilm.encode(PROMPTS)
    expected = reference.encode(PROMPTS, convert_to_tensor=True)
    assert torch.allclose(features.sentence, expected, atol=1e-5)
    words = reference.encode(PROMPTS, output_value="token_embeddings")
    for row, (mask, states) in enumerate(zip(features.mask, words, strict=True)):
        # the library drops padding from the end; so does the mask
        assert torch.allclose(features.words[row][mask], states[: int(mask.sum())], atol=1e-5)


def test_minilm_shapes_and_determinism(minilm: TextEncoder) -> None:
    one, two = minilm.encode(PROMPTS), minilm.encode(PROMPTS)
    assert one.sentence.shape == (5, minilm.dim) and one.words.shape == (*one.mask.shape, minilm.dim)
    assert one.mask.shape[1] == 256
    assert torch.equal(one.sentence, two.sentence) and torch.equal(one.words, two.words)
    assert not one.sentence.requires_grad
    assert torch.allclose(one.sentence.norm(dim=-1), torch.ones(5), atol=1e-6)
    assert (one.words[~one.mask] == 0).all() and one.mask.any(1).all()


def test_minilm_batch_equals_loop(minilm: TextEncoder) -> None:
    batch = minilm.encode(PROMPTS)
    for row, prompt in enumerate(PROMPTS):
        alone = minilm.encode([prompt])
        assert torch.allclose(alone.sentence[0], batch.sentence[row], atol=1e-5)
        assert torch.equal(alone.mask[0].sum(), batch.mask[row].sum())


def test_minilm_tells_meanings_apart(minilm: TextEncoder) -> None:
    walk, stroll, jump = minilm.encode(["a person walks", "someone strolls along", "a man does a backflip"]).sentence
    assert walk @ stroll > walk @ jump


@pytest.mark.parametrize("name", ["minilm", "none"])
def test_no_prompts_give_no_features(name: str) -> None:
    if name == "minilm":
        pytest.importorskip(MINILM_PACKAGE)
    encoder = load_text_encoder(name)
    features = encoder.encode([])
    assert features.sentence.shape == (0, encoder.dim) and features.words.shape[0] == 0


def test_none_says_nothing() -> None:
    encoder = load_text_encoder("none")
    features = encoder.encode(["a", "b"])
    assert features.sentence.shape == (2, encoder.dim) and not features.sentence.any()
    assert features.mask.shape == (2, 1) and features.mask.all()


def _tiny_clip(folder: Path) -> None:
    transformers = pytest.importorskip("transformers")
    alphabet = sorted(set("abcdefghijklmnopqrstuvwxyz"))
    tokens = [*alphabet, *(letter + "</w>" for letter in alphabet), "<|startoftext|>", "<|endoftext|>"]
    folder.mkdir()
    (folder / "vocab.json").write_text(json.dumps({token: i for i, token in enumerate(tokens)}))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    torch.manual_seed(0)
    config = transformers.CLIPTextConfig(
        vocab_size=len(tokens), hidden_size=16, intermediate_size=32, num_hidden_layers=2, num_attention_heads=2,
        max_position_embeddings=12, bos_token_id=len(tokens) - 2, eos_token_id=len(tokens) - 1,
    )  # fmt: skip
    transformers.CLIPTextModel(config).save_pretrained(folder)


def test_clip_from_a_folder(tmp_path: Path) -> None:
    folder = tmp_path / "clip"
    _tiny_clip(folder)
    encoder = load_text_encoder(folder)
    features = encoder.encode(["walk", "a person runs very far away"])
    assert encoder.dim == 16 and features.words.shape == (2, 12, 16)  # the second prompt is cut at 12 tokens
    assert features.mask.sum(1).tolist() == [6, 12]
    # the sentence is the state at the end-of-text token, the last real one
    assert torch.allclose(features.sentence[0], features.words[0, 5], atol=1e-6)
    again = load_text_encoder(folder).encode(["walk", "a person runs very far away"])
    assert torch.equal(features.sentence, again.sentence)
    assert encoder.encode([]).sentence.shape == (0, 16)


def test_errors_name_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="did you mean 'minilm'"):
        load_text_encoder("mini-lm")
    with pytest.raises(UserError, match="neither a known name nor a folder"):
        load_text_encoder(tmp_path / "absent")
    with pytest.raises(UserError, match=r"lacks config\.json"):
        load_text_encoder(tmp_path)
    (tmp_path / "config.json").write_text("{")
    with pytest.raises(UserError, match="not readable JSON"):
        load_text_encoder(tmp_path)
    (tmp_path / "config.json").write_text('{"model_type": "llama"}')
    with pytest.raises(UserError, match="type 'llama'"):
        load_text_encoder(tmp_path)
    (tmp_path / "config.json").write_text('{"model_type": "clip"}')
    with pytest.raises(UserError, match=r"lacks model\.safetensors"):
        load_text_encoder(tmp_path)
    (tmp_path / "model.safetensors").write_bytes(b"not weights")
    with pytest.raises(UserError, match=r"lacks vocab\.json"):
        load_text_encoder(tmp_path)
    (tmp_path / "config.json").write_text('{"model_type": "bert"}')
    with pytest.raises(UserError, match="damaged"):
        load_text_encoder(tmp_path)


def test_minilm_loads_from_a_folder_too(minilm: TextEncoder) -> None:
    package = pytest.importorskip(MINILM_PACKAGE)
    copy = load_text_encoder(package.get_model_path())
    assert isinstance(copy, MiniLM) and copy.name == str(package.get_model_path())
    assert torch.equal(copy.encode(PROMPTS[:2]).sentence, minilm.encode(PROMPTS[:2]).sentence)


def test_missing_package_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenectl.networks.text.MINILM_PACKAGE", "no_such_encoder_package")
    with pytest.raises(UserError, match="pip install no-such-encoder-package"):
        load_text_encoder("minilm")
