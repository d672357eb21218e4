"""The text encoder agrees with the library it stands in for, is deterministic, and fails in one sentence."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file

from scenectl.networks.text import MINILM_PACKAGE, MiniLM, TextEncoder, _BertConfig, load_text_encoder
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
    with pytest.raises(UserError, match=r"config\.json.*not readable JSON"):
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
    with pytest.raises(UserError, match="'hidden_size' is missing"):
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


BERT = {
    "model_type": "bert", "hidden_size": 8, "intermediate_size": 16, "num_hidden_layers": 2, "num_attention_heads": 2,
    "max_position_embeddings": 16, "vocab_size": 10, "type_vocab_size": 2, "layer_norm_eps": 1e-12,
    "hidden_act": "gelu",
}  # fmt: skip


def _tiny_bert(folder: Path) -> dict[str, torch.Tensor]:
    """A folder as sentence encoders come in; returns its tensors."""
    tokenizers = pytest.importorskip("tokenizers")
    words = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "a", "person", "walks", "forward", "turns", "runs"]
    model = tokenizers.models.WordPiece({word: i for i, word in enumerate(words)}, unk_token="[UNK]")
    made = tokenizers.Tokenizer(model)
    made.pre_tokenizer = tokenizers.pre_tokenizers.Whitespace()
    made.post_processor = tokenizers.processors.BertProcessing(("[SEP]", 3), ("[CLS]", 2))
    folder.mkdir()
    made.save(str(folder / "tokenizer.json"))
    (folder / "config.json").write_text(json.dumps(BERT))
    torch.manual_seed(0)
    shapes = _BertConfig.model_validate(BERT).shapes
    tensors = {name: torch.randn(shape) * 0.1 for name, shape in shapes.items()}
    save_file({f"bert.{name}": value for name, value in tensors.items()}, folder / "model.safetensors")
    return tensors


def _refused(folder: Path) -> str:
    with pytest.raises(UserError) as error:
        load_text_encoder(folder)
    text = str(error.value)
    assert "\n" not in text and str(folder) in text and len(text) < 500
    return text


def test_a_small_bert_reads_sentences(tmp_path: Path) -> None:
    _tiny_bert(tmp_path / "bert")
    encoder = load_text_encoder(tmp_path / "bert")
    features = encoder.encode(["a person walks", "", "zebra " * 40])
    assert encoder.dim == 8 and features.mask.sum(1).tolist() == [5, 2, 16]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *((key, value) for key in ("hidden_size", "vocab_size", "num_attention_heads") for value in (0, -1, 2**63)),
        ("num_hidden_layers", 10**9), ("num_hidden_layers", 3), ("num_attention_heads", 3), ("hidden_size", 16),
        ("max_position_embeddings", 2), ("max_position_embeddings", 17), ("vocab_size", 9), ("intermediate_size", "x"),
        ("layer_norm_eps", float("nan")), ("layer_norm_eps", -1), ("hidden_act", "relu"), ("pad_token_id", -1),
        ("vocab_size", None), ("type_vocab_size", 1),
    ],
)  # fmt: skip
def test_configurations_that_cannot_be_are_refused(key: str, value: object, tmp_path: Path) -> None:
    folder = tmp_path / "bert"
    _tiny_bert(folder)
    (folder / "config.json").write_text(json.dumps({**BERT, key: value}))
    assert "copy" in _refused(folder)


def test_damaged_files_of_a_text_encoder_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "bert"
    tensors = _tiny_bert(folder)
    for file in ("tokenizer.json", "model.safetensors", "config.json"):
        whole = (folder / file).read_bytes()
        for length in (0, 20, len(whole) // 2, len(whole) - 1):
            (folder / file).write_bytes(whole[:length])
            assert file in _refused(folder)
        (folder / file).write_bytes(whole)
    for name in ("embeddings.word_embeddings.weight", "encoder.layer.1.output.LayerNorm.bias"):
        save_file({key: value for key, value in tensors.items() if key != name}, folder / "model.safetensors")
        assert f"wants {name}" in _refused(folder)
        save_file({**tensors, name: torch.full_like(tensors[name], torch.nan)}, folder / "model.safetensors")
        assert "not finite" in _refused(folder)
        save_file({**tensors, name: torch.full_like(tensors[name], 1e38)}, folder / "model.safetensors")
    (folder / "sentence_bert_config.json").write_text('{"max_seq_length": -5}')
    _refused(folder)


def test_words_that_the_model_has_no_row_for_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "bert"
    _tiny_bert(folder)
    written = json.loads((folder / "tokenizer.json").read_text())
    written["model"]["vocab"]["runs"] = 10**6
    (folder / "tokenizer.json").write_text(json.dumps(written))
    assert "numbers its words up to 1000000" in _refused(folder)
    written["model"]["vocab"]["runs"] = 9
    written["post_processor"]["cls"] = ["[CLS]", 10**6]
    (folder / "tokenizer.json").write_text(json.dumps(written))
    _refused(folder)


def test_damaged_folders_of_clip_are_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "clip"
    _tiny_clip(folder)
    whole = {path.name: path.read_bytes() for path in folder.iterdir()}
    state = load_file(folder / "model.safetensors")
    capfd.readouterr()  # what the library says when it saves
    name = next(iter(state))
    save_file(
        {key: value for key, value in state.items() if key != name}, folder / "model.safetensors", {"format": "pt"}
    )
    assert f"lacks {name.removeprefix('text_model.')}" in _refused(folder).replace("text_model.", "")
    save_file({**state, name: torch.full_like(state[name], torch.nan)}, folder / "model.safetensors", {"format": "pt"})
    assert "not finite" in _refused(folder)
    (folder / "model.safetensors").write_bytes(whole["model.safetensors"])
    for key, value in (("vocab_size", 20), ("hidden_size", 2**40), ("num_hidden_layers", 10**9), ("hidden_size", 24)):
        (folder / "config.json").write_text(json.dumps({**json.loads(whole["config.json"]), key: value}))
        _refused(folder)
    (folder / "config.json").write_bytes(whole["config.json"])
    (folder / "vocab.json").write_bytes(whole["vocab.json"][:-20])
    _refused(folder)
    assert capfd.readouterr() == ("", "")
