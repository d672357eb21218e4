"""What the scale-wise transformer may look at, and that its three ways of computing agree."""

from __future__ import annotations

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from scenectl.generators.mscot.bundle import load_bundle
from scenectl.generators.mscot.networks.refiner import Refiner
from scenectl.generators.mscot.networks.transformer import Attention, Cache, _edges, _word_bias, sinusoids
from scenectl.generators.weights import described, weights_folder
from scenectl.networks.text import Said, TextFeatures, TimedText
from tests.scenectl.small import REFINER, SCALES, Words, bundle

FINEST = 9
PREFIXES = ["previous", "cumulative"]
PROMPTS = ["a person walks", "someone sits down on a chair"]


def prompt(*texts: str) -> TimedText:
    return TimedText.whole(Words().encode(list(texts or PROMPTS)))


def timeline(*sentences: tuple[str, float, float]) -> TimedText:
    """One motion's sentences with begin and end, in tokens of the finest scale."""
    encoded = ((Words().encode([text]), begin, end) for text, begin, end in sentences)
    return TimedText.of([[Said(one.sentence[0], one.words[0], begin, end) for one, begin, end in encoded]])


def tokens(made, batch: int = 2, seed: int = 0) -> list[Tensor]:
    draw = torch.Generator().manual_seed(seed)
    return [torch.randint(16, (batch, n), generator=draw) for n in made.tokenizer.quantiser.lengths(FINEST)]


def forward(made, given: list[Tensor], text: TimedText) -> list[Tensor]:
    """Logits of every scale."""
    q = made.tokenizer.quantiser
    return list(made.transformer(q, text, given, FINEST).split(list(q.lengths(FINEST)), dim=1))


@pytest.mark.parametrize("prefix", PREFIXES)
def test_tokens_of_a_scale_reach_only_finer_scales(prefix: str) -> None:
    made = bundle(prefix=prefix)
    given = tokens(made)
    before = forward(made, given, prompt())
    for k in range(len(SCALES)):
        changed = [t if i != k else (t + 5) % 16 for i, t in enumerate(given)]
        after = forward(made, changed, prompt())
        for i in range(len(SCALES)):
            if i <= k:
                torch.testing.assert_close(after[i], before[i], atol=1e-5, rtol=1e-5)
        if k + 1 < len(SCALES):
            assert (after[k + 1] - before[k + 1]).abs().max() > 1e-3
    # The first scale's token reaches every finer scale's input, through attention at the least.
    changed = [(given[0] + 5) % 16, *given[1:]]
    assert all(
        (a - b).abs().max() > 1e-4 for a, b in zip(forward(made, changed, prompt())[1:], before[1:], strict=True)
    )


@pytest.mark.parametrize("prefix", PREFIXES)
def test_training_caching_and_computing_anew_agree(prefix: str) -> None:
    made = bundle(prefix=prefix)
    q, given, cache = made.tokenizer.quantiser, tokens(made), Cache()
    codes = [q.lookup(k, t) for k, t in enumerate(given)]
    for k, wanted in enumerate(forward(made, given, prompt())):
        anew = made.transformer.predict(q, prompt(), codes[:k], k, FINEST)
        cached = made.transformer.predict(q, prompt(), codes[:k], k, FINEST, cache)
        torch.testing.assert_close(anew, wanted, atol=1e-5, rtol=1e-4)
        torch.testing.assert_close(cached, wanted, atol=1e-5, rtol=1e-4)
        assert cache.keys[0].shape[2] == sum(q.lengths(FINEST)[: k + 1])


def test_a_position_sees_all_of_its_own_scale() -> None:
    """Scales are predicted in parallel, so attention within a scale is not masked."""
    made = bundle()
    q = made.tokenizer.quantiser
    codes = [q.lookup(k, t) for k, t in enumerate(tokens(made))][:3]
    codes[2] = codes[2].clone().requires_grad_(True)
    logits = made.transformer.predict(q, prompt(), codes, 3, FINEST)
    (gradient,) = torch.autograd.grad(logits[:, 0].square().sum(), codes[2])
    assert (gradient.abs().sum(-1) > 0).all()


def test_the_previous_scales_codes_are_the_input_of_the_next_as_the_paper_has_it() -> None:
    made = bundle(prefix="previous")
    q, given = made.tokenizer.quantiser, tokens(made)
    codes = [q.lookup(k, t) for k, t in enumerate(given)]
    length = q.lengths(FINEST)[2]
    up = F.interpolate(codes[1].transpose(1, 2), size=length, mode="linear", align_corners=False).transpose(1, 2)
    other = made.transformer.inputs(q, prompt(), [torch.zeros_like(codes[0]), codes[1]], 2, FINEST)
    got = made.transformer.inputs(q, prompt(), codes[:2], 2, FINEST)
    torch.testing.assert_close(got, other)  # coarser scales are reached by attention alone
    zero = made.transformer.inputs(q, prompt(), [codes[0], torch.zeros_like(codes[1])], 2, FINEST)
    torch.testing.assert_close(got - zero, up @ made.transformer.code.weight.T, atol=1e-5, rtol=1e-4)


def test_all_scales_so_far_are_the_input_of_the_next_with_the_cumulative_prefix() -> None:
    made = bundle(prefix="cumulative")
    q, given = made.tokenizer.quantiser, tokens(made)
    codes = [q.lookup(k, t) for k, t in enumerate(given)]
    so_far = q.down(q.latent(codes[:2], FINEST), q.lengths(FINEST)[2]).transpose(1, 2)
    zeros = [torch.zeros_like(e) for e in codes[:2]]
    silent = q.down(q.latent(zeros, FINEST), q.lengths(FINEST)[2]).transpose(1, 2)  # the convolutions' biases
    got = made.transformer.inputs(q, prompt(), codes[:2], 2, FINEST)
    zero = made.transformer.inputs(q, prompt(), zeros, 2, FINEST)
    torch.testing.assert_close(got - zero, (so_far - silent) @ made.transformer.code.weight.T, atol=1e-5, rtol=1e-4)


def test_text_matters_and_dropped_text_equals_no_text() -> None:
    made = bundle()
    given = tokens(made)
    told = forward(made, given, prompt())
    assert all((a - b).abs().max() > 1e-3 for a, b in zip(told, forward(made, given, prompt("x y", "z")), strict=True))
    drop = made.transformer.without_text
    none = [forward(made, given, drop(prompt(*texts), torch.tensor([True, True]))) for texts in (PROMPTS, ["x", "y z"])]
    half = forward(made, given, drop(prompt(), torch.tensor([True, False])))
    for k in range(len(SCALES)):
        torch.testing.assert_close(none[0][k], none[1][k], atol=1e-5, rtol=1e-5)
        torch.testing.assert_close(half[k][0], none[0][k][0], atol=1e-5, rtol=1e-5)
        torch.testing.assert_close(half[k][1], told[k][1], atol=1e-5, rtol=1e-5)


def test_words_of_the_padding_are_never_read() -> None:
    made = bundle()
    given, text = tokens(made), Words().encode(PROMPTS)
    noise = torch.where(text.mask[..., None], text.words, 50 * torch.randn_like(text.words))
    padded = TextFeatures(text.sentence, F.pad(noise, (0, 0, 0, 3), value=9.0), F.pad(text.mask, (0, 3)))
    text, longer = TimedText.whole(text), TimedText.whole(padded)
    for got, wanted in zip(forward(made, given, longer), forward(made, given, text), strict=True):
        torch.testing.assert_close(got, wanted, atol=1e-5, rtol=1e-5)


def fused(self: Attention, x: Tensor, key: Tensor, value: Tensor, bias: Tensor | None) -> Tensor:
    """Attention as it was when the shipped weights were trained: torch's own, masks that only say yes or no."""
    mask = None if bias is None else bias > -1.0
    out = F.scaled_dot_product_attention(self.split(self.query(x)), key, value, attn_mask=mask)
    return self.out(out.transpose(1, 2).flatten(2))


def test_one_sentence_is_read_as_it_was_before_sentences_had_times(monkeypatch: pytest.MonkeyPatch) -> None:
    made = load_bundle(described(weights_folder("default")), with_metric=False)
    q, model = made.tokenizer.quantiser, made.transformer
    said = TimedText.whole(made.text.encode(PROMPTS))
    text = model.without_text(said, torch.tensor([False, True]))
    given = [torch.randint(512, (2, n), generator=torch.Generator().manual_seed(n)) for n in q.lengths(FINEST)]
    with torch.no_grad():
        got = model(q, text, given, FINEST)
        wanted = model.sentence(said.sentence).expand(-1, q.lengths(FINEST)[0], -1)
        silent = said.each(torch.zeros_like)
        given_text = model.inputs(q, said, [], 0, FINEST) - model.inputs(q, silent, [], 0, FINEST)
        torch.testing.assert_close(given_text, wanted - model.sentence.bias, atol=1e-5, rtol=1e-5)
        monkeypatch.setattr(Attention, "attend", fused)
        torch.testing.assert_close(got, model(q, text, given, FINEST), atol=1e-5, rtol=1e-5)


def test_a_sentence_said_again_and_again_is_one_sentence() -> None:
    """Words count as their sentence's share says: a copy for each part of a motion makes no difference."""
    made = bundle()
    given = [t[:1] for t in tokens(made)]
    parts = timeline(*((PROMPTS[0], at, at + 3.0) for at in (0.0, 3.0, 6.0)))
    for got, wanted in zip(forward(made, given, parts), forward(made, given, prompt(PROMPTS[0])), strict=True):
        torch.testing.assert_close(got, wanted, atol=1e-5, rtol=1e-5)


def test_tokens_read_the_sentences_of_their_own_time() -> None:
    made = bundle()
    q, lengths = made.tokenizer.quantiser, made.tokenizer.quantiser.lengths(FINEST)
    text = timeline((PROMPTS[0], 0.0, 5.0), (PROMPTS[1], 5.0, 9.0))
    first = len(PROMPTS[0].split())
    for length in lengths:
        reads = _word_bias(text, _edges([length], FINEST, torch.device("cpu")))[0].exp()
        edges = torch.linspace(0, FINEST, length + 1)
        early, late = edges[1:] <= 5, edges[:-1] >= 5
        assert (reads[early, first:] < 1e-20).all() and (reads[late, :first] < 1e-20).all()
        assert (reads[early, :first] == 1).all() and (reads[late, first:] == 1).all()
        both = ~early & ~late
        assert (reads[both] > 0.1).all()
        torch.testing.assert_close(reads[both, 0] + reads[both, -1], torch.ones(int(both.sum())))
    assert lengths[0] == 2  # of 4.5 tokens each
    later = (0.5 * text.sentence[0, 0] + 4 * text.sentence[0, 1]) / 4.5
    wanted = torch.stack([text.sentence[0, 0], later]) @ made.transformer.sentence.weight.T
    told, untold = (made.transformer.inputs(q, each, [], 0, FINEST)[0] for each in (text, text.each(torch.zeros_like)))
    torch.testing.assert_close(told - untold, wanted, atol=1e-5, rtol=1e-5)


def test_what_is_said_later_changes_what_comes_later() -> None:
    made = bundle()
    for block in made.transformer.blocks:  # tokens see one another only here
        torch.nn.init.zeros_(block.self_attention.out.weight)
    given = [t[:1] for t in tokens(made)]
    one, other = (timeline((PROMPTS[0], 0.0, 5.0), (text, 5.0, 9.0)) for text in (PROMPTS[1], "another thing"))
    change = (forward(made, given, one)[-1] - forward(made, given, other)[-1])[0].abs().amax(-1)
    assert (change[:5] < 1e-5).all() and (change[5:] > 1e-3).all()


def test_times_that_nothing_is_said_of_are_still_numbers() -> None:
    made = bundle()
    given = [t[:1] for t in tokens(made)]
    text = timeline((PROMPTS[0], 0.0, 2.0), (PROMPTS[1], 7.0, 8.0))
    dropped = made.transformer.without_text(text, torch.tensor([True]))
    none = made.transformer.without_text(prompt("x"), torch.tensor([True]))
    assert all(logits.isfinite().all() for logits in forward(made, given, text))
    for got, wanted in zip(forward(made, given, dropped), forward(made, given, none), strict=True):
        torch.testing.assert_close(got, wanted, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("prefix", PREFIXES)
def test_a_batch_is_a_loop_over_its_samples(prefix: str) -> None:
    made = bundle(prefix=prefix)
    given = tokens(made)
    both = forward(made, given, prompt())
    for sample, text in enumerate(PROMPTS):
        alone = forward(made, [t[sample : sample + 1] for t in given], prompt(text))
        for k in range(len(SCALES)):
            torch.testing.assert_close(both[k][sample], alone[k][0], atol=1e-5, rtol=1e-4)


def test_duration_is_an_input() -> None:
    made = bundle()
    q = made.tokenizer.quantiser
    short, long = (made.transformer.predict(q, prompt(), [], 0, n) for n in (5, 10))
    assert (short[:, 0] - long[:, 0]).abs().max() > 1e-4


def test_positions_are_times_that_all_scales_share() -> None:
    at = torch.linspace(0, 60, 241)
    table = sinusoids(at, 64)
    near = (table[1:] - table[:-1]).norm(dim=-1).max()
    apart = torch.cdist(table, table) + 1e9 * (torch.cdist(at[:, None], at[:, None]) < 1.0)
    assert near < apart.min()  # no two distant times look alike


def test_an_untrained_refiner_changes_nothing_and_a_trained_one_knows_scale_and_place() -> None:
    torch.manual_seed(0)
    refiner = Refiner(REFINER, 16, len(SCALES))
    e = torch.randn(2, 5, 16)
    for k in range(len(SCALES)):
        assert torch.equal(refiner(e, k, 9), torch.zeros_like(e))
    torch.nn.init.normal_(refiner.outward.weight)
    assert (refiner(e, 0, 9) - refiner(e, 1, 9)).abs().max() > 1e-4
    assert (refiner(e.flip(1), 0, 9).flip(1) - refiner(e, 0, 9)).abs().max() > 1e-4
    torch.testing.assert_close(refiner(e, 2, 9)[:1], refiner(e[:1], 2, 9), atol=1e-5, rtol=1e-4)
