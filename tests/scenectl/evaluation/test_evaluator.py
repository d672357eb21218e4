"""Our evaluator and the classifier of kinds: padding, losses, weights on disk, confusion."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from scenectl.data.features import joints_to_features
from scenectl.evaluation import contrastive, kinds
from scenectl.evaluation.contrastive import Contrastive, ContrastiveConfig, ContrastiveEvaluator, load_contrastive
from scenectl.evaluation.evaluator import Evaluator, load_evaluator
from scenectl.evaluation.kinds import Confusion, KindClassifier, load_classifier
from scenectl.evaluation.motions import EncoderConfig, MotionEncoder, Padded
from scenectl.evaluation.training import EvaluatorTraining, train_evaluator
from scenectl.networks.checkpoint import save_weights
from scenectl.training.loop import LoopSettings
from scenes.errors import UserError
from tests.scenectl.small import Words, walk
from tests.scenectl.training.folder import same, walks

SMALL = EncoderConfig(width=16, depth=2, out=8)


def clips(*frames: int) -> list[torch.Tensor]:
    return [joints_to_features(walk(n + 1, speed=0.6 + 0.01 * n)) for n in frames]


def test_padding_and_company_change_nothing() -> None:
    torch.manual_seed(0)
    encoder = MotionEncoder(SMALL).eval()
    made = clips(40, 88, 60)
    together = encoder(Padded.of(made))
    for i, clip in enumerate(made):
        torch.testing.assert_close(together[i], encoder(Padded.of([clip]))[0], atol=1e-5, rtol=1e-4)


def test_lengths_are_cut_to_whole_steps_and_to_the_longest() -> None:
    batch = Padded.of(clips(43, 210))
    assert batch.lengths.tolist() == [40, 196] and batch.features.shape == (2, 196, 263)
    assert not batch.features[0, 40:].any()


def small_contrastive() -> Contrastive:
    torch.manual_seed(0)
    return Contrastive(ContrastiveConfig(motion=SMALL, text="none", text_dim=6, hidden=8)).eval()


def test_embeddings_have_length_one_in_the_order_asked_for() -> None:
    evaluator = ContrastiveEvaluator(small_contrastive(), Words())
    assert isinstance(evaluator, Evaluator)
    made = clips(*range(40, 40 + 70))
    points = evaluator.embed_motions(made)
    torch.testing.assert_close(points.norm(dim=-1), torch.ones(70))
    torch.testing.assert_close(points[67:68], evaluator.embed_motions(made[67:68]), atol=1e-5, rtol=1e-4)
    texts = evaluator.embed_texts(["b b", "a", "b b"])
    assert torch.equal(texts[0], texts[2]) and not torch.equal(texts[0], texts[1])
    torch.testing.assert_close(texts[1], evaluator.embed_texts(["a"])[0])


def test_captions_that_say_the_same_are_not_held_against_one_another() -> None:
    model, batch = small_contrastive(), Padded.of(clips(40, 60, 80))
    sentences = torch.randn(3, 6, generator=torch.Generator().manual_seed(1))
    repeated = sentences.clone()
    repeated[1] = repeated[0]
    similarity = (model.embed_motions(batch) @ model.embed_sentences(repeated).T / model.temperature.exp()).detach()
    alone = torch.tensor([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]).bool()
    kept = similarity.masked_fill(alone, -torch.inf)
    own = kept.diagonal()
    wanted = ((kept.logsumexp(1) - own).mean() + (kept.logsumexp(0) - own).mean()) / 2
    torch.testing.assert_close(model.loss(batch, repeated).detach(), wanted)


def test_a_confusion_counts_what_was_taken_for_what() -> None:
    true = ["walk"] * 6 + ["run"] * 5 + ["hop"] * 4
    predicted = ["walk"] * 3 + ["run"] * 3 + ["run"] * 5 + ["walk"] * 4
    found = Confusion.of(true, predicted)
    assert found.counts.tolist() == [[0, 0, 4], [0, 5, 0], [0, 3, 3]]
    assert found.recall() == {"run": 1.0, "walk": 0.5}  # four hops are too few to count
    assert found.macro_recall == 0.75


def brief(iterations: int) -> EvaluatorTraining:
    loop = LoopSettings(iterations=iterations, batch=6, learning_rate=1e-3)
    return EvaluatorTraining(contrastive=loop, kinds=loop)


def test_training_learns_resumes_and_writes_what_loads(tmp_path: Path) -> None:
    folder = walks(tmp_path / "data")
    whole = train_evaluator(folder, tmp_path / "whole", settings=brief(4))
    train_evaluator(folder, tmp_path / "parts", settings=brief(2))
    parts = train_evaluator(folder, tmp_path / "parts", settings=brief(4).model_copy())
    classifier = load_classifier(whole)
    assert {"bandai: walk", "walk"} <= set(classifier.kinds)
    assert len(classifier.predict(clips(40, 60))) == 2
    assert load_contrastive(whole).embed_motions(clips(40)).shape == (1, 128)
    assert load_classifier(parts).kinds == classifier.kinds


def test_missing_and_foreign_weights_are_answered(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="unknown evaluator 'ownn'; did you mean 'own'"):
        load_evaluator("ownn")
    with pytest.raises(UserError, match="do not exist"):
        load_evaluator("own", tmp_path)
    for file, load in ((contrastive.FILE, load_contrastive), (kinds.FILE, load_classifier)):
        save_weights(KindClassifier(["walk"], 8, 1), tmp_path / file, {"config": {"nonsense": 1}})
        with pytest.raises(UserError, match="train it again"):
            load(tmp_path)


def test_equal_seeds_give_equal_weights(tmp_path: Path) -> None:
    folder, states = walks(tmp_path / "data"), []
    for name in ("a", "b"):
        states.append(load_classifier(train_evaluator(folder, tmp_path / name, settings=brief(1))).state_dict())
    assert same(*states)
