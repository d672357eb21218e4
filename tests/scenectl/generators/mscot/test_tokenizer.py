"""Algorithms 1 and 2 against loops written from the paper, and what training does to codes."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from scenectl.generators.mscot.networks.tokenizer import Quantiser, Tokenizer
from tests.scenectl.small import SCALES, config, quantiser

CHOICES = [{}, {"normalised": False}, {"down": "area"}]


def resized(x: Tensor, length: int, *, area: bool = False) -> Tensor:
    """Linear interpolation ``[L, d] -> [length, d]`` between the middles of cells, or means over cells, by hand."""
    size = x.shape[0]
    if length == size:
        return x
    if area:
        cells = [(i * size // length, -(-(i + 1) * size // length)) for i in range(length)]
        return torch.stack([x[a:b].mean(0) for a, b in cells])
    at = np.clip((np.arange(length) + 0.5) * size / length - 0.5, 0, size - 1)
    columns = [np.interp(at, np.arange(size), column.numpy()) for column in x.detach().T]
    return torch.from_numpy(np.stack(columns, axis=-1)).to(x)


def contribution(q: Quantiser, k: int, e: Tensor, finest: int) -> Tensor:
    """Conv1D(Up_K(e)) of one sample, ``[L, d]``, the convolution as a sum over three taps."""
    x = resized(e, finest)
    number = int(np.rint(k * (len(q.convs) - 1) / (len(SCALES) - 1)))
    weight, bias = q.convs[number].weight.detach(), q.convs[number].bias.detach()
    padded = F.pad(x, (0, 0, 1, 1))
    convolved = sum(padded[tap : tap + finest] @ weight[:, :, tap].T for tap in range(3)) + bias
    return 0.5 * x + 0.5 * convolved


def algorithm_1(q: Quantiser, f: Tensor) -> list[list[int]]:
    """Tokens of one latent ``[L, d]``, as the paper's listing goes."""
    rest, z = f.clone(), []
    for k, length in enumerate(q.lengths(len(f))):
        u = resized(rest, length, area=q.config.down == "area")
        codes = q.codebook * (q.gain[k] if q.config.normalised else 1.0)
        z.append([int(np.argmin([float((code - row).norm()) for code in codes])) for row in u])
        rest = rest - contribution(q, k, codes[z[-1]], len(f))
    return z


def algorithm_2(q: Quantiser, z: list[list[int]]) -> Tensor:
    """Latent of one sample's tokens."""
    total = torch.zeros(len(z[-1]), q.config.code_dim)
    for k, tokens in enumerate(z):
        codes = q.codebook * (q.gain[k] if q.config.normalised else 1.0)
        total = total + contribution(q, k, codes[tokens], len(z[-1]))
    return total


@pytest.mark.parametrize("choice", CHOICES)
@pytest.mark.parametrize("finest", [5, 9, 13])
def test_encoding_is_algorithm_1(choice: dict[str, object], finest: int) -> None:
    q = quantiser(**choice)
    f = 2 * torch.randn(2, 16, finest)
    tokens = q.encode(f)
    for sample in range(2):
        assert [t[sample].tolist() for t in tokens] == algorithm_1(q, f[sample].T)


@pytest.mark.parametrize("choice", CHOICES)
@pytest.mark.parametrize("finest", [5, 11])
def test_decoding_is_algorithm_2(choice: dict[str, object], finest: int) -> None:
    torch.manual_seed(3)
    model = Tokenizer(config(**choice).tokenizer).eval()
    model.quantiser.load_state_dict(quantiser(**choice).state_dict())
    tokens = [torch.randint(16, (2, length)) for length in model.quantiser.lengths(finest)]
    by_hand = torch.stack([algorithm_2(model.quantiser, [t[s].tolist() for t in tokens]).T for s in range(2)])
    torch.testing.assert_close(model.decode(tokens), model.decode_latent(by_hand), atol=1e-5, rtol=1e-5)
    embeddings = [model.quantiser.lookup(k, t) for k, t in enumerate(tokens)]
    torch.testing.assert_close(model.quantiser.latent(embeddings, finest), by_hand, atol=1e-5, rtol=1e-5)


def test_all_convolutions_are_used_in_order_and_the_ends_have_their_own() -> None:
    q = quantiser()
    used = []
    for k in range(len(SCALES)):
        e = torch.randn(1, 5, 16)
        outcomes = [0.5 * e.transpose(1, 2) + 0.5 * conv(e.transpose(1, 2)) for conv in q.convs]
        used.append(next(i for i, o in enumerate(outcomes) if torch.allclose(o, q.up(k, e, 5), atol=1e-6)))
    assert used == sorted(used) and set(used) == {0, 1, 2}


def test_the_latent_is_affine_in_the_embeddings_and_a_sum_over_scales() -> None:
    q = quantiser()
    a, b = ([torch.randn(2, length, 16) for length in q.lengths(9)] for _ in range(2))
    mixed = [0.3 * x + 0.7 * y for x, y in zip(a, b, strict=True)]
    torch.testing.assert_close(q.latent(mixed, 9), 0.3 * q.latent(a, 9) + 0.7 * q.latent(b, 9), atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(q.latent(a, 9), torch.stack([q.up(k, e, 9) for k, e in enumerate(a)]).sum(0))


@pytest.mark.parametrize("k", range(len(SCALES)))
def test_a_residual_made_of_a_scales_own_codes_is_recovered_by_that_scale(k: int) -> None:
    q = quantiser()
    tokens = torch.randint(16, (4, 7))
    assert torch.equal(q.nearest(k, q.lookup(k, tokens).transpose(1, 2)), tokens)


@pytest.mark.parametrize("down", ["linear", "area"])
def test_a_constant_latent_of_one_code_is_found_at_the_first_scale_and_explained_away(down: str) -> None:
    q = quantiser(down=down)
    for conv in q.convs:  # the identity: the middle tap passes, the others are silent
        torch.nn.init.dirac_(conv.weight)
        torch.nn.init.zeros_(conv.bias)
    for code in range(16):
        f = q.lookup(0, torch.tensor([[code]])).expand(1, 5, 16).transpose(1, 2)
        tokens = q.encode(f)
        assert tokens[0].tolist() == [[code]]
        first = q.up(0, q.lookup(0, tokens[0]), 5)
        torch.testing.assert_close(first, f)


def test_gradients_pass_straight_through_to_the_encoder() -> None:
    torch.manual_seed(0)
    model = Tokenizer(config().tokenizer)
    latent = model.latent(torch.randn(3, 20, 263)).detach().requires_grad_(True)
    quantised = model.quantiser(latent)
    weights = torch.randn_like(latent)
    (gradient,) = torch.autograd.grad((quantised.latent * weights).sum(), latent)
    torch.testing.assert_close(gradient, weights)
    model.decode_latent(model.quantiser(model.latent(torch.randn(3, 20, 263))).latent).square().sum().backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in model.encoder.parameters())


def test_quantised_latents_are_what_the_tokens_decode_to() -> None:
    q = quantiser()
    f = torch.randn(3, 16, 9)
    got = q(f)
    assert all(torch.equal(a, b) for a, b in zip(got.tokens, q.encode(f), strict=True))
    torch.testing.assert_close(got.latent, q.latent([q.lookup(k, t) for k, t in enumerate(got.tokens)], 9))


def test_dropout_keeps_a_prefix_of_the_scales() -> None:
    q = quantiser()
    f = torch.randn(4, 16, 9)
    got = q(f, torch.tensor([1, 2, 3, 4]))
    for sample, keep in enumerate([1, 2, 3, 4]):
        codes = [q.lookup(k, t[sample : sample + 1]) for k, t in enumerate(got.tokens)]
        torch.testing.assert_close(got.latent[sample : sample + 1], q.latent(codes[:keep], 9))


def test_the_losses_are_those_of_eq_37_and_reach_only_whom_they_should() -> None:
    q = quantiser()
    f = torch.randn(2, 16, 9, requires_grad=True)
    got = q(f)
    total, wanted = torch.zeros_like(f), 0.0
    for k, t in enumerate(got.tokens):
        total = total + q.up(k, q.lookup(k, t), 9)
        wanted = wanted + (total - f).square().mean() / len(SCALES)
    torch.testing.assert_close(got.codebook_loss, wanted)
    torch.testing.assert_close(got.commitment_loss, wanted)
    weights = list(q.convs.parameters())
    assert torch.autograd.grad(got.codebook_loss, f, retain_graph=True, allow_unused=True)[0] is None
    assert torch.autograd.grad(got.commitment_loss, f, retain_graph=True)[0].abs().sum() > 0
    assert all(g.abs().sum() > 0 for g in torch.autograd.grad(got.codebook_loss, weights, retain_graph=True))
    unused = torch.autograd.grad(got.commitment_loss, weights, allow_unused=True)
    assert all(g is None for g in unused)


def naive_update(q: Quantiser, f: Tensor, decay: float) -> tuple[Tensor, Tensor, Tensor]:
    """Usage, codes and gains after one step, one vector at a time."""
    usage, sums, gain = q.usage.clone() * decay, q.sums.clone() * decay, q.gain.clone()
    rest = f.clone()
    for k, length in enumerate(q.lengths(f.shape[-1])):
        u = q.down(rest, length)
        tokens = q.nearest(k, u)
        projections = []
        for sample in range(len(f)):
            for position in range(length):
                v, code = u[sample, :, position], int(tokens[sample, position])
                projections.append(float(v @ q.codebook[code]))
                usage[code] += 1 - decay
                sums[code] += (1 - decay) * (v / v.norm() if q.config.normalised else v)
        if q.config.normalised:
            gain[k] = decay * gain[k] + (1 - decay) * max(float(np.mean(projections)), 1e-3)
        rest = rest - q.up(k, q.lookup(k, tokens), f.shape[-1])
    codes = sums / usage[:, None]
    return usage, (F.normalize(codes, dim=-1) if q.config.normalised else codes), gain


@pytest.mark.parametrize("normalised", [True, False])
@torch.no_grad()
def test_the_codebook_follows_a_moving_average_of_what_it_encoded(normalised: bool) -> None:
    q = quantiser(normalised=normalised).train()
    f = torch.randn(3, 16, 9)
    usage, codes, gain = naive_update(q, f, 0.9)
    q(f)
    q.update_codebook(0.9, revive_below=0.0)
    torch.testing.assert_close(q.usage, usage)
    torch.testing.assert_close(q.codebook, codes)
    torch.testing.assert_close(q.gain, gain)
    if normalised:
        torch.testing.assert_close(q.codebook.norm(dim=-1), torch.ones(16))


@pytest.mark.parametrize("normalised", [True, False])
@torch.no_grad()
def test_codes_that_nothing_uses_restart_on_data(normalised: bool) -> None:
    q = quantiser(normalised=normalised).train()
    q.usage[[3, 8]] = 1e-4
    q.codebook[[3, 8]] = q.sums[[3, 8]] = -100.0 if not normalised else q.codebook[[3, 8]]
    f = torch.zeros(2, 16, 9)
    f[:, 0] = 5.0  # every vector points the same way, so that one code takes them all
    q(f)
    pool = torch.cat(list(q._seen.pool.values()))
    assert q.update_codebook(0.5, revive_below=0.05) == 2
    for code in (3, 8):
        assert min(float((q.codebook[code] - v).norm()) for v in pool) < 1e-4
        assert q.usage[code] > 0.05
    assert torch.isfinite(q.codebook).all()


def _distance(a: Tensor, b: Tensor) -> Tensor:
    """From each row of `a` to the nearest of `b`, exactly."""
    return torch.cdist(a, b, compute_mode="donot_use_mm_for_euclid_dist").amin(1)


@torch.no_grad()
def test_restarts_of_a_shared_codebook_come_from_every_scale() -> None:
    q = quantiser(normalised=False).train()
    q(torch.randn(8, 16, 9))
    shown = {k: pool.clone() for k, pool in q._seen.pool.items()}
    q.usage.zero_()
    assert q.update_codebook(1.0, revive_below=0.05) == 16
    near = {k: _distance(q.codebook, pool) < 1e-4 for k, pool in shown.items()}
    assert torch.stack(list(near.values())).any(0).all() and sum(bool(hit.any()) for hit in near.values()) > 1


@torch.no_grad()
def test_scales_with_codes_of_their_own_learn_and_restart_apart() -> None:
    q = quantiser(shared_codebook=False).train()
    count, f = len(SCALES), torch.randn(4, 16, 9)
    assert q.codebook.shape == (16 * count, 16)
    q.initialise(f)
    tokens = q(f).tokens
    assert all(int(t.max()) < 16 for t in tokens)
    used = q._seen.count.view(count, 16)
    for k, t in enumerate(tokens):
        torch.testing.assert_close(used[k], torch.bincount(t.flatten(), minlength=16).float())
    shown = {k: F.normalize(pool, dim=-1) for k, pool in q._seen.pool.items()}
    q.usage.zero_()
    q.update_codebook(1.0, revive_below=0.05)
    for k, pool in shown.items():
        assert (_distance(q.codebook[16 * k : 16 * (k + 1)], pool) < 1e-4).all()
    torch.testing.assert_close(q.codes(2), q.codebook[32:48] * q.gain[2])


@torch.no_grad()
def test_nothing_is_learned_from_dropped_scales_or_while_evaluating() -> None:
    q = quantiser().eval()
    before = q.codebook.clone()
    q(torch.randn(2, 16, 9))
    q.update_codebook(0.5, 1.0)
    assert torch.equal(q.codebook, before)
    q.train()
    q(torch.randn(2, 16, 9), torch.tensor([1, 1]))
    assert q._seen is not None and float(q._seen.count.sum()) == 2 * q.lengths(9)[0]


@pytest.mark.parametrize("normalised", [True, False])
@torch.no_grad()
def test_initial_codes_come_from_data(normalised: bool) -> None:
    q = quantiser(normalised=normalised)
    f = 4 * torch.randn(6, 16, 9)
    before = (f - q.latent([q.lookup(k, t) for k, t in enumerate(q.encode(f))], 9)).square().mean()
    q.initialise(f)
    after = (f - q.latent([q.lookup(k, t) for k, t in enumerate(q.encode(f))], 9)).square().mean()
    assert after < before
    torch.testing.assert_close(q.gain[0], q.down(f, q.lengths(9)[0]).norm(dim=1).mean())


@pytest.mark.parametrize("finest", [1, 2, 9, 49])
def test_the_decoder_makes_four_frames_of_a_token_and_the_encoder_undoes_that(finest: int) -> None:
    model = Tokenizer(config().tokenizer).eval()
    features = model.decode_latent(torch.randn(2, 16, finest))
    assert features.shape == (2, 4 * finest, 263)
    assert model.latent(features).shape == (2, 16, finest)


def test_statistics_normalise_the_input_and_restore_the_output() -> None:
    model = Tokenizer(config().tokenizer).eval()
    x = torch.randn(1, 20, 263)
    z, y = model.latent(x), model.decode_latent(torch.ones(1, 16, 5))
    model.mean.copy_(torch.randn(263))
    model.std.copy_(torch.rand(263) + 0.5)
    torch.testing.assert_close(model.latent(x * model.std + model.mean), z, atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(model.decode_latent(torch.ones(1, 16, 5)), y * model.std + model.mean)


def test_decoding_some_scales_only_says_what_to_use_instead() -> None:
    model = Tokenizer(config().tokenizer)
    with pytest.raises(ValueError, match=r"quantiser\.latent"):
        model.decode([torch.zeros(1, 1, dtype=torch.long)])
