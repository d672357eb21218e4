"""The evaluator of Guo et al.: parameters as published, padding and order, words, and what a folder must hold.

Its weights may not be shipped, so that random ones stand in for them.
"""

from __future__ import annotations

import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from scenectl.data.features import CONTACTS, GROUPS
from scenectl.evaluation.evaluator import Evaluator, load_evaluator
from scenectl.evaluation.guo import EMPHASIS, HUMANML3D_STD, PARTS, GuoEvaluator, GuoNetwork, check_normalisation
from scenectl.evaluation.guo_text import _LISTED, CLASSES, CONVERT, Vocabulary
from scenes.errors import UserError

WORDS = ["a", "man", "walk", "slowly", "unk", "sos", "eos", "left", "in", "circle"]
TEXTS = (
    "a man walks slowly.#a/DET man/NOUN walk/VERB slowly/ADV#0.0#0.0\n"
    "A man walks left in a circle#a/DET man/NOUN walk/VERB left/ADV in/ADP a/DET circle/NOUN#0.0#0.0\n"
)


def deviations(emphasis: float) -> Tensor:
    """HumanML3D's deviations with those of root and contacts made smaller."""
    std = torch.empty(263)
    for i, (group, value) in enumerate(zip(GROUPS, HUMANML3D_STD, strict=True)):
        std[group] = value / (emphasis if i in (0, 1, 2, 6) else 1.0)
    return std


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as `guo` describes it, of random weights."""
    torch.manual_seed(0)
    path, network = tmp_path_factory.mktemp("guo"), GuoNetwork()
    state = {name: network.get_submodule(name).state_dict() for name in PARTS}
    optimiser: dict[str, object] = {"state": {}, "param_groups": []}  # the published archive holds such as well
    torch.save({**state, "opt_motion_encoder": optimiser, "epoch": 3, "iter": 9}, _weights(path))
    np.save(path / "t2m_mean.npy", np.linspace(-0.1, 0.1, 263, dtype=np.float32))
    np.save(path / "t2m_std.npy", deviations(EMPHASIS).numpy())
    np.save(path / "our_vab_data.npy", torch.randn(len(WORDS), 300).numpy())
    (path / "our_vab_words.txt").write_text("\n".join(WORDS), encoding="utf-8")
    (path / "texts").mkdir()
    (path / "texts" / "000001.txt").write_text(TEXTS, encoding="utf-8")
    return path


def _weights(path: Path) -> Path:
    return path / "finest.tar"


@pytest.fixture(scope="module")
def evaluator(folder: Path) -> GuoEvaluator:
    made = load_evaluator("guo", folder)
    assert isinstance(made, GuoEvaluator) and isinstance(made, Evaluator)
    return made


@pytest.fixture
def copy(folder: Path, tmp_path: Path) -> Path:
    """A copy of the folder, to break; the large file is a link, to be replaced and never written through."""
    made = Path(shutil.copytree(folder, tmp_path / "guo", ignore=shutil.ignore_patterns("finest.tar")))
    _weights(made).symlink_to(_weights(folder))
    return made


def motions(*frames: int) -> list[Tensor]:
    generator = torch.Generator().manual_seed(1)
    return [torch.randn(n, 263, generator=generator) * deviations(EMPHASIS) for n in frames]


def test_parameters_have_the_published_names_and_shapes() -> None:
    shapes = {name: tuple(value.shape) for name, value in GuoNetwork().state_dict().items()}
    both = ("weight", "bias")
    gru = {f"gru.{kind}_{side}_l0{way}" for kind in both for side in ("ih", "hh") for way in ("", "_reverse")}
    layers = ("input_emb", "output_net.0", "output_net.1", "output_net.3")
    motion = {"hidden"} | gru | {f"{layer}.{kind}" for layer in layers for kind in both}
    movement = {f"{layer}.{kind}" for layer in ("main.0", "main.3", "out_net") for kind in both}
    text = motion | {"pos_emb.weight", "pos_emb.bias"}
    wanted = {"movement_encoder": movement, "motion_encoder": motion, "text_encoder": text}
    assert shapes.keys() == {f"{part}.{name}" for part, names in wanted.items() for name in names}
    assert shapes["movement_encoder.main.0.weight"] == (512, 259, 4)
    assert shapes["motion_encoder.input_emb.weight"] == (1024, 512)
    assert shapes["motion_encoder.gru.weight_ih_l0"] == (3 * 1024, 1024)
    assert shapes["motion_encoder.hidden"] == (2, 1, 1024) and shapes["text_encoder.hidden"] == (2, 1, 512)
    assert shapes["motion_encoder.output_net.0.weight"] == (1024, 2048)
    assert shapes["motion_encoder.output_net.3.weight"] == (512, 1024)
    assert shapes["text_encoder.pos_emb.weight"] == (300, 15) and shapes["text_encoder.input_emb.weight"] == (512, 300)
    assert shapes["text_encoder.gru.weight_ih_l0"] == (3 * 512, 512)
    assert shapes["text_encoder.output_net.3.weight"] == (512, 512)


def test_order_and_company_change_nothing(evaluator: GuoEvaluator) -> None:
    made = motions(40, 196, 88, 60)
    together = evaluator.embed_motions(made)
    assert together.shape == (4, 512)
    for i, motion in enumerate(made):
        torch.testing.assert_close(together[i], evaluator.embed_motions([motion])[0], atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(evaluator.embed_motions(made[::-1]), together.flip(0), atol=1e-5, rtol=1e-4)
    assert (together[0] - together[2]).norm() > 1e-3


def test_more_than_one_batch_stays_in_order(evaluator: GuoEvaluator) -> None:
    made = motions(*(40 + 4 * (i % 5) for i in range(66)))
    last = evaluator.embed_motions(made[64:])
    torch.testing.assert_close(evaluator.embed_motions(made)[64:], last, atol=1e-5, rtol=1e-4)


def test_motions_go_the_way_of_the_protocol(evaluator: GuoEvaluator) -> None:
    # One motion, every step written out: normalised, padded with zeros, contacts dropped, a quarter of its length read.
    motion, network = motions(60)[0], evaluator.network
    rows = torch.zeros(1, 196, 259)
    rows[0, :60] = ((motion - evaluator.mean) / evaluator.std)[:, :259]
    moved, weights = rows.transpose(1, 2), network.movement_encoder
    for layer in (weights.main[0], weights.main[3]):
        assert isinstance(layer, nn.Conv1d)
        moved = nn.functional.conv1d(moved, layer.weight, layer.bias, stride=2, padding=1)
        moved = nn.functional.leaky_relu(moved, 0.2)
    steps = network.motion_encoder.input_emb(weights.out_net(moved.transpose(1, 2)[:, :15]))
    _, last = network.motion_encoder.gru(steps, network.motion_encoder.hidden)
    wanted = network.motion_encoder.output_net(last.transpose(0, 1).reshape(1, -1))
    torch.testing.assert_close(evaluator.embed_motions([motion]), wanted, atol=1e-5, rtol=1e-4)


def test_contacts_and_odd_frames_are_not_read(evaluator: GuoEvaluator) -> None:
    motion = motions(60)[0]
    changed = motion.clone()
    changed[:, CONTACTS] += 1.0
    longer = torch.cat([changed, motion[:3]])
    torch.testing.assert_close(*(evaluator.embed_motions([m]) for m in (motion, changed)))
    torch.testing.assert_close(*(evaluator.embed_motions([m]) for m in (motion, longer)))


def test_texts_come_back_in_order_whatever_their_lengths(evaluator: GuoEvaluator) -> None:
    short, long = "a man walks slowly.", "a man walks left in a circle"
    together = evaluator.embed_texts([short, long, short])
    assert together.shape == (3, 512) and torch.equal(together[0], together[2])
    for caption, point in zip((short, long), together, strict=False):
        torch.testing.assert_close(evaluator.embed_texts([caption])[0], point, atol=1e-5, rtol=1e-4)
    assert (together[0] - together[1]).norm() > 1e-3
    with pytest.raises(UserError, match=r"caption 'a man flies' has no tagged words"):
        evaluator.embed_texts([short, "a man flies"])


def test_words_and_their_classes(evaluator: GuoEvaluator) -> None:
    vocabulary = evaluator.vocabulary
    vectors, classes = vocabulary.read_tokens(["man/NOUN", "walk/VERB", "left/VERB", "slowly/ADV", "in/ADP", "a/PUNCT"])
    names = [CLASSES[i] for i in classes.tolist()]
    assert names == ["OTHER", "NOUN", "action", "location", "description", "ADP", "OTHER", "OTHER"]
    assert torch.equal(vectors, vocabulary.vectors[[5, 1, 2, 7, 3, 8, 0, 6]])
    # A listed word without a vector is unknown in its class as well.
    vectors, classes = vocabulary.read_tokens(["jump/VERB"])
    assert torch.equal(vectors[1], vocabulary.vectors[4]) and CLASSES[int(classes[1])] == "OTHER"
    assert len(vocabulary.read_tokens(["man/NOUN"] * 30)[0]) == 22
    assert len(CLASSES) == 15 and len(_LISTED) == 12 + 13 + 10 + 34 + 12


def test_only_the_evaluators_own_normalisation_is_taken(copy: Path) -> None:
    check_normalisation(deviations(25.2), copy)
    np.save(copy / "t2m_std.npy", deviations(1.0).numpy())
    with pytest.raises(UserError, match=r"HumanML3D's own deviations.*25 times smaller.*Comp_v6_KLD01/meta"):
        load_evaluator("guo", copy)
    np.save(copy / "t2m_std.npy", deviations(5.0).numpy())
    with pytest.raises(UserError, match="deviations of something else"):
        load_evaluator("guo", copy)


def test_the_data_sets_own_normalisation_is_refused(shared: Path) -> None:
    std = torch.from_numpy(np.load(shared / "data" / "humanml3d" / "Std.npy"))
    with pytest.raises(UserError, match="HumanML3D's own deviations"):
        check_normalisation(std, Path("Std.npy"))


class Trap:
    """Calls something when it is unpickled."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return exec, ("import builtins; builtins.sprung = True",)


@pytest.mark.parametrize("archive", ["torch", "pickle"])
def test_weights_that_would_run_something_are_refused(copy: Path, archive: str) -> None:
    _weights(copy).unlink()
    if archive == "torch":
        torch.save({"movement_encoder": Trap()}, _weights(copy))
    else:
        _weights(copy).write_bytes(pickle.dumps(Trap(), protocol=2))
    with pytest.raises(UserError, match="no torch archive of plain tensors"):
        load_evaluator("guo", copy)
    import builtins

    assert not hasattr(builtins, "sprung")


def test_weights_of_another_network_are_refused(copy: Path) -> None:
    archive = torch.load(_weights(copy), weights_only=True)
    _weights(copy).unlink()
    for broken in ({}, {**archive, "text_encoder": archive["motion_encoder"]}, [1, 2]):
        torch.save(broken, _weights(copy))
        with pytest.raises(UserError, match="not those of the evaluator"):
            load_evaluator("guo", copy)
    archive["movement_encoder"]["out_net.bias"][0] = torch.nan
    torch.save(archive, _weights(copy))
    with pytest.raises(UserError, match="not finite"):
        load_evaluator("guo", copy)


@pytest.mark.parametrize(
    ("gone", "answer"),
    [
        ("finest.tar", "fetch text_mot_match"),
        ("t2m_mean.npy", "does not exist"),
        ("t2m_std.npy", "does not exist"),
        ("our_vab_data.npy", "does not exist"),
        ("our_vab_words.txt", "our_vab_idx.pkl"),
        ("texts/000001.txt", "put HumanML3D's folder 'texts' there"),
    ],
)
def test_what_is_missing_is_named(copy: Path, gone: str, answer: str) -> None:
    (copy / gone).unlink()
    with pytest.raises(UserError, match=answer):
        load_evaluator("guo", copy)
    with pytest.raises(UserError, match="--evaluator-folder"):
        load_evaluator("guo")


def test_words_and_vectors_belong_together(copy: Path) -> None:
    (copy / "our_vab_words.txt").write_text("\n".join(WORDS[:-1]), encoding="utf-8")
    with pytest.raises(UserError, match="9 different words for 10 vectors"):
        Vocabulary.read(copy)
    np.save(copy / "our_vab_data.npy", np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(UserError, match="not a NumPy array"):
        Vocabulary.read(copy)


def test_the_command_that_errors_name_makes_the_list_of_words(copy: Path) -> None:
    import shlex
    import subprocess
    import sys

    (copy / "our_vab_words.txt").unlink()
    shuffled = dict(sorted({word: i for i, word in enumerate(WORDS)}.items()))
    (copy / "our_vab_idx.pkl").write_bytes(pickle.dumps(shuffled))
    subprocess.run([sys.executable, *shlex.split(CONVERT)[1:]], cwd=copy, check=True)
    assert Vocabulary.read(copy).rows == {word: i for i, word in enumerate(WORDS)}


@pytest.mark.parametrize("name", ["finest.tar", "t2m_mean.npy", "t2m_std.npy", "our_vab_data.npy", "our_vab_words.txt"])
@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"\xff\xfe\x80", b"\x80\x02c__builtin__\neval\n", None])
def test_whatever_is_wrong_with_a_file_is_one_sentence(name: str, content: bytes | None, copy: Path) -> None:
    whole = (copy / name).read_bytes()
    (copy / name).unlink()
    (copy / name).write_bytes(whole[: len(whole) // 2] if content is None else content)
    with pytest.raises(UserError) as error:
        load_evaluator("guo", copy)
    assert "\n" not in str(error.value) and name in str(error.value)
