"""MSCoT: tokens from coarse to fine, each scale's posterior tilted once (algorithm 3, as far as refinement)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from scenectl.data.features import FPS, features_to_joints
from scenectl.generators.base import Draft, Guide, Progress, Step, silent
from scenectl.generators.conditions import Conditions
from scenectl.generators.mscot.bundle import Bundle
from scenectl.generators.mscot.keeping import Kept, covering, in_turns
from scenectl.generators.mscot.networks.transformer import Cache
from scenectl.generators.mscot.posterior import Posterior, Scale, clip_at, clipped, tilted
from scenectl.generators.mscot.schedule import DOWNSAMPLING, tokens_for
from scenectl.generators.mscot.settings import SPEC, Sampling
from scenectl.generators.mscot.step import step_of
from scenectl.generators.prompts import Prompts
from scenectl.generators.spec import check_request
from scenectl.generators.windows import Windows
from scenectl.networks.precision import cpu_has_bfloat16
from scenectl.networks.text import Said, TimedText
from scenectl.threads import threads
from scenes.errors import UserError
from scenes.motion.motion import Motion, Pose2D

SEAM = 10.0
"""Certainty with which a window follows its neighbour: `closeness` is counted so many times over."""


@dataclass
class _State:
    """One generation under way.

    Attributes:
        frames: frames asked for; the decoder makes a multiple of four, the rest is cut off.
        windows: over the tokens of the finest scale; a single one up to 196 frames. W of them stand one after the
            other along the second axis of all that follows.
        codes: embeddings of the tokens drawn so far, by scale, ``[S, W * L_k, d]``.
        refined: the same with the refiner's residuals.
        latent: of what is refined, a row for each window, ``[S * W, d, L]``; None before the first scale.
        moved: nats by which goals moved each scale's distribution, mean KL a position.
        kept: what an edit keeps of a motion.
    """

    frames: int
    windows: Windows
    start: Pose2D
    codes: list[Tensor]
    refined: list[Tensor]
    moved: list[float]
    kept: Kept | None = None
    latent: Tensor | None = None

    @property
    def finest(self) -> int:
        """Tokens of a window at the finest scale."""
        return self.windows.length


@dataclass(frozen=True)
class Placing:
    """Puts features ``[S, T, c]`` into the world, cut to the frames that were asked for; see `_State`."""

    frames: int
    start: Pose2D
    kept: Kept | None

    @classmethod
    def of(cls, state: _State) -> Placing:
        """Of a generation."""
        return cls(state.frames, state.start, state.kept)

    def __call__(self, features: Float[Tensor, "S T c"]) -> Motion:
        motion = Motion(features_to_joints(features[:, : self.frames]), fps=FPS)
        return motion.placed(self.start) if self.kept is None else self.kept.placed(motion)

    def take(self, samples: Int[Tensor, " s"]) -> Placing:
        return self if self.kept is None else replace(self, kept=self.kept.take(samples))


class MSCoT:
    """The generator behind one bundle of weights.

    Attributes:
        posterior: how a guide changes a scale's distribution.
    """

    name, spec = "mscot", SPEC

    def __init__(self, bundle: Bundle, sampling: Sampling | None = None, posterior: Posterior = tilted) -> None:
        self.bundle, self.posterior = bundle, posterior
        self.sampling = sampling or Sampling()
        self.quantiser = bundle.tokenizer.quantiser
        single = self.quantiser.codebook.dtype is torch.float32
        self._rough = torch.bfloat16 if single and cpu_has_bfloat16() else None

    @property
    def licence(self) -> str:
        return self.bundle.licence

    @threads()
    def generate(
        self,
        prompts: Prompts | str,
        seconds: float,
        start: Pose2D,
        *,
        conditions: Conditions | None = None,
        guide: Guide | None = None,
        samples: int = 1,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> Draft:
        """Motions for sentences, in world coordinates, ``[samples, T, 22, 3]`` with T = seconds x 20.

        Raises:
            UserError: no text, a sentence that begins after the end, no sample, no start, or a length outside 1.8 to
                120 s.
        """
        told, frames = check_request(self.name, self.spec, prompts, seconds, start, samples)
        state = _State(frames, covering(tokens_for(frames)), start, [], [], [])
        return self._made(state, told, guide, samples, seed, progress)

    @threads()
    def edit(
        self,
        motion: Motion,
        regenerate: Bool[Tensor, " T"],
        prompts: Prompts | str,
        *,
        guide: Guide | None = None,
        samples: int = 1,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> Draft:
        """Parts of a motion made anew, in its own frame, by keeping the tokens of the rest.

        The motion is ``[T, 22, 3]``, or there is one for each sample, ``[samples, T, 22, 3]``.

        Lengths are those of one window, 36 to 196 frames at 20 fps. Raises UserError for others, and where
        `regenerate` holds no frame or all of them.
        """
        told, frames = check_request(self.name, self.spec, prompts, motion.frames / FPS, Pose2D(), samples)
        if frames > self.spec.window_frames:
            low, high = self.spec.shortest_frames, self.spec.window_frames
            raise UserError(f"the motion has {frames} frames; one that can be edited has {low} to {high}")
        if regenerate.all() or not regenerate.any():
            raise UserError("an edit keeps some frames and makes others anew; this one has only one kind")
        kept = Kept.of(self.bundle.tokenizer, motion, regenerate)
        state = _State(frames, covering(tokens_for(frames)), Pose2D(), [], [], [], kept)
        return self._made(state, told, guide, samples, seed, progress)

    def round_trip(self, features: Float[Tensor, "C T 263"]) -> Float[Tensor, "C T 263"]:
        """Raw features after a round trip through tokens, T a multiple of four."""
        return self.bundle.tokenizer.decode(self.bundle.tokenizer.encode(features))

    def round_trips(self, seen: Float[Tensor, "W T 263"]) -> dict[str, Callable[[Tensor], Tensor]]:
        """Round trips through a part of the code (`scenectl.generators.mscot.coding`)."""
        from scenectl.generators.mscot.coding import round_trips  # what generates has no use for it

        return round_trips(self.bundle, seen)

    def from_random_tokens(self, frames: int, draw: torch.Generator) -> Float[Tensor, "1 T 263"]:
        """Raw features of tokens drawn uniformly, `frames` a multiple of four."""
        lengths, codes = self.quantiser.lengths(tokens_for(frames)), self.bundle.config.tokenizer.codes
        return self.bundle.tokenizer.decode([torch.randint(codes, (1, n), generator=draw) for n in lengths])

    def _made(
        self, state: _State, told: Prompts, guide: Guide | None, samples: int, seed: int, progress: Progress | None
    ) -> Draft:
        draw = torch.Generator().manual_seed(seed)
        self._draw_tokens(state, self._text(told, state.windows, samples), guide, draw, progress or silent)
        step = self._refinable(state)
        trace = {"tilt_kl_nats": state.moved, "frames": state.frames, "told": [str(one) for one in told.sentences]}
        return Draft(step.motion, step, trace)

    def _text(self, prompts: Prompts, windows: Windows, samples: int) -> TimedText:
        """What each window of every sample is told, then 'no text' for each (classifier-free guidance)."""
        spans = prompts.spans()
        features = self.bundle.text.encode([prompt.text.lower().strip() for prompt in spans])
        rate, rows = FPS / DOWNSAMPLING, list[list[Said]]()
        for first in windows.starts:
            times = [(p.begin * rate - first, math.inf if p.end is None else p.end * rate - first) for p in spans]
            said = zip(features.sentence, features.words, features.mask, times, strict=True)
            rows.append([Said(s, w[m], *t) for s, w, m, t in said if t[0] < windows.length and t[1] > 0])
        told = TimedText.of(rows).each(lambda x: x.repeat(2 * samples, *(1 for _ in x.shape[1:])))
        drop = torch.arange(len(told.owner), device=told.owner.device) >= samples * windows.count
        return self.bundle.transformer.without_text(told, drop)

    def _draw_tokens(
        self, state: _State, text: TimedText, guide: Guide | None, draw: torch.Generator, progress: Progress
    ) -> None:
        cache = Cache()
        for k in range(self.quantiser.scales):
            progress("tokens", k / self.quantiser.scales)
            logits = self._prior(state, text, k, cache)
            if guide is not None:
                logits = self._guided(state, logits, k, guide)
            codes = self.quantiser.lookup(k, self._tokens(state, logits, k, draw))
            state.codes.append(codes)
            with torch.no_grad():
                residual = self.bundle.refiner(state.windows.rows(codes), k, state.finest)
                state.refined.append(codes + state.windows.series(residual))
                state.latent = self._onto(state, state.refined[k], k)

    def _tokens(
        self, state: _State, logits: Float[Tensor, "S M V"], k: int, draw: torch.Generator
    ) -> Int[Tensor, "S M"]:
        """Tokens of scale k; those of windows agree with their neighbours'."""
        sampling, windows = self.sampling, state.windows
        if state.kept is not None:
            close = state.kept.closeness(self.quantiser, state.refined, len(logits))
            tokens = _sample(logits + clipped(SEAM * close, sampling.clip_nats), sampling.top_p, draw)
            return state.kept.replaced(self.quantiser, tokens, close, k)
        if windows.count == 1:
            return _sample(logits, sampling.top_p, draw)

        def sample(logits: Tensor, closeness: Tensor) -> Tensor:
            return _sample(logits + clipped(SEAM * closeness, sampling.clip_nats), sampling.top_p, draw)

        done = [windows.rows(e) for e in state.refined]
        return windows.series(in_turns(windows, self.quantiser, windows.rows(logits), done, sample))

    @torch.no_grad()
    def _prior(self, state: _State, text: TimedText, k: int, cache: Cache) -> Float[Tensor, "S L_k V"]:
        """Log-probabilities of scale k's tokens given text and coarser tokens."""
        twice = [torch.cat([e, e]) for e in map(state.windows.rows, state.codes)]
        both = self.bundle.transformer.predict(self.quantiser, text, twice, k, state.finest, cache)
        told, untold = both.chunk(2)
        several, _ = text.several.chunk(2)
        weight = cfg_at(self.sampling, k, self.quantiser.scales, several).to(told)[:, None, None]
        logits = untold + weight * (told - untold)
        return state.windows.series((logits / self.sampling.temperature).log_softmax(-1))

    def _guided(self, state: _State, prior: Float[Tensor, "S L_k V"], k: int, guide: Guide) -> Float[Tensor, "S L_k V"]:
        """Log-probabilities of scale k's tokens given the guide, too."""
        codes, scales = self.quantiser.codes(k), self.quantiser.scales
        nats = clip_at(self.sampling, k, scales, len(prior)).to(prior)
        scale = Scale(k, self._scale_step(state, prior.exp() @ codes, k), prior, codes, nats)
        posterior = self.posterior(scale, guide)
        state.moved.append(float((posterior.exp() * (posterior - prior)).sum(-1).mean()))
        return posterior

    def _step(self, state: _State, value: Tensor, latent: Callable[[Tensor], Tensor]) -> Step:
        """A step whose value leads to the latent of the whole motion."""
        return step_of(self.bundle.tokenizer, value, latent, Placing.of(state), self._rough)

    def _scale_step(self, state: _State, value: Float[Tensor, "S M d"], k: int) -> Step:
        """A step whose value holds the embeddings of scale k, the next one."""
        now = replace(state)  # however far the drawing goes on
        return self._step(state, value, lambda e: now.windows.join(self._onto(now, e, k)))

    def _onto(self, state: _State, e: Float[Tensor, "S M d"], k: int) -> Float[Tensor, "R d L"]:
        """Latent of every window with the embeddings of scale k, the next one, on top of what is refined."""
        own = self.quantiser.up(k, state.windows.rows(e), state.finest)
        if state.latent is None:
            return own
        return (
            state.latent.repeat(len(own) // len(state.latent), 1, 1) + own
        )  # several gradients of all samples at once

    def _latent(self, state: _State, embeddings: list[Float[Tensor, "S _M d"]]) -> Float[Tensor, "S d N"]:
        """Latent of the whole motion, for as many scales as there are."""
        windows = state.windows
        return windows.join(self.quantiser.latent([windows.rows(e) for e in embeddings], state.finest))

    def _refinable(self, state: _State) -> Step:
        """Continuous residuals of all scales at once (Eq. 12), in the metric of the decoder."""
        lengths, metric = [e.shape[1] for e in state.refined], self.bundle.metric
        value = torch.cat(state.refined if metric is None else metric.coordinates(state.refined), dim=1)

        def latent(value: Float[Tensor, "S M d"]) -> Tensor:
            parts = list(value.split(lengths, dim=1))
            return self._latent(state, parts if metric is None else metric.embeddings(parts))

        return self._step(state, value, latent)


def cfg_at(sampling: Sampling, k: int, scales: int, several: Bool[Tensor, " B"]) -> Float[Tensor, " B"]:
    """Classifier-free guidance weights at scale k of `scales`, of motions that are told `several` sentences or one.

    A coarse token is about several sentences at once, so that each says less to it than one alone would: their weight
    falls evenly from `cfg_coarsest` times `cfg` at the coarsest scale.
    """
    share = 1 - k / max(1, scales - 1)
    return sampling.cfg * (1 + (sampling.cfg_coarsest - 1) * share * several)


def _sample(logits: Float[Tensor, "S L V"], top_p: float, draw: torch.Generator) -> Int[Tensor, "S L"]:
    """Tokens from the nucleus of each position's distribution, drawn on the CPU so that a seed decides everywhere."""
    p = logits.softmax(-1)
    ordered, index = p.sort(-1, descending=True)
    outside = ordered.cumsum(-1) - ordered >= top_p
    ordered = ordered.masked_fill(outside, 0.0)
    picks = torch.multinomial(ordered.flatten(0, 1).cpu(), 1, generator=draw).unflatten(0, logits.shape[:2])
    return index.gather(-1, picks.to(index.device)).squeeze(-1)
