"""MSCoT: tokens from coarse to fine, each scale's posterior tilted once, residuals refined at the end (algorithm 3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import torch
from jaxtyping import Bool, Float, Int
from pydantic import BaseModel, ConfigDict, Field
from torch import Tensor

from scenectl.data.features import FPS, features_to_joints
from scenectl.generators.base import Generation, Guide, Progress, Step
from scenectl.generators.mscot.bundle import Bundle
from scenectl.generators.mscot.keeping import Kept
from scenectl.generators.mscot.networks.transformer import Cache
from scenectl.generators.mscot.schedule import MAX_FRAMES, MIN_FRAMES, tokens_for
from scenectl.generators.mscot.windows import Windows, in_turns
from scenectl.generators.steps import LatentStep
from scenectl.networks.precision import cpu_has_bfloat16
from scenectl.networks.text import TextFeatures
from scenes.errors import UserError
from scenes.motion.motion import Motion, Pose2D

MAX_SECONDS = 60.0
"""Beyond this a request is taken for a mistake; the schedule itself has no limit."""

SEAM = 10.0
"""Certainty with which a window follows its neighbour: `closeness` is counted so many times over."""


class Sampling(BaseModel):
    """How tokens are drawn.

    Attributes:
        cfg: classifier-free guidance weight on the logits, before any goal (the paper: 5). More follows rare words of
            a sentence better, such as "ducks", and makes feet slide.
        temperature: of the softmax.
        top_p: smallest set of tokens with this share of what is drawn from (the prior, tilted where there are goals)
            is kept; 1 keeps all.
        clip_nats: largest spread of a position's tilt between codes (nats) at the finest scale: an unclipped tilt can
            overrule the prior altogether. Coarser scales may be tilted less (`clip_at`). 0 leaves tilts as they are.
        clip_coarsest: share of that spread for the coarsest scale of the first sample.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    cfg: float = Field(default=2.0, ge=0)
    temperature: float = Field(default=0.7, gt=0)
    top_p: float = Field(default=0.95, gt=0, le=1)
    clip_nats: float = Field(default=20.0, ge=0)
    clip_coarsest: float = Field(default=0.25, gt=0, le=1)

    def clip_at(self, k: int, scales: int, samples: int) -> Float[Tensor, " S"]:
        """Largest spread (nats) of every sample's tilt at scale k of so many, from 0.

        A coarse token moves the whole motion: a body that is pushed there slides to a few keyframes, and one that is
        not finds no way around a wall. So the first sample's limit grows evenly from `clip_coarsest` of `clip_nats` at
        the coarsest scale, the last one's is the same at all, and those of samples in between lie in between.
        """
        coarsest = torch.linspace(self.clip_coarsest, 1.0, samples)
        return self.clip_nats * (coarsest + (1 - coarsest) * k / max(scales - 1, 1))


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
class Tilt:
    """One scale's guidance, for whoever wants to look at it.

    Attributes:
        k: the scale, from 0.
        step: prior-mean embeddings (Eq. 11) and their decoder.
        prior: log-probabilities before guidance, ``[S, L_k, V]``.
        first_order: log-likelihood of every code to first order (Eq. 10), up to a constant and unclipped.
        codes: embeddings of the codes at this scale, ``[V, d]``.
        nats: spread to which each sample's tilt is clipped, ``[S]``.
    """

    k: int
    step: Step
    prior: Float[Tensor, "S L_k V"]
    first_order: Float[Tensor, "S L_k V"]
    codes: Float[Tensor, "V d"]
    nats: Float[Tensor, " S"]


class MSCoT:
    """The generator behind one bundle of weights.

    Attributes:
        observer: called with each scale's `Tilt` when a guide is at work.
    """

    name = "mscot"
    fps = FPS

    def __init__(
        self, bundle: Bundle, sampling: Sampling | None = None, observer: Callable[[Tilt], None] | None = None
    ) -> None:
        self.bundle, self.observer = bundle, observer
        self.sampling = sampling or Sampling()
        self.quantiser = bundle.tokenizer.quantiser
        single = self.quantiser.codebook.dtype is torch.float32
        self._rough = torch.bfloat16 if single and cpu_has_bfloat16() else None

    @property
    def licence(self) -> str:
        return self.bundle.licence

    def generate(
        self,
        prompt: str,
        seconds: float,
        start: Pose2D,
        guide: Guide | None = None,
        samples: int = 1,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> Generation:
        """Motions for a prompt, in world coordinates, ``[samples, T, 22, 3]`` with T = seconds x 20.

        Raises:
            UserError: no text, no sample, or a length outside 1.8 to 60 s.
        """
        frames = self._frames(prompt, seconds, samples)
        draw = torch.Generator().manual_seed(seed)
        state = _State(frames, Windows.covering(tokens_for(frames)), start, [], [], [])
        return self._made(state, prompt, guide, samples, draw, progress)

    def edit(
        self,
        motion: Motion,
        regenerate: Bool[Tensor, " T"],
        prompt: str,
        guide: Guide | None = None,
        samples: int = 1,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> Generation:
        """Parts of a motion ``[T, 22, 3]`` made anew, in its own frame, by keeping the tokens of the rest.

        Lengths are those of one window, 36 to 196 frames at 20 fps. Raises UserError for others, and where
        `regenerate` holds no frame or all of them.
        """
        frames = self._frames(prompt, motion.frames / FPS, samples)
        if frames > MAX_FRAMES:
            raise UserError(f"the motion has {frames} frames; one that can be edited has {MIN_FRAMES} to {MAX_FRAMES}")
        if regenerate.all() or not regenerate.any():
            raise UserError("an edit keeps some frames and makes others anew; this one has only one kind")
        kept = Kept.of(self.bundle.tokenizer, motion, regenerate)
        state = _State(frames, Windows.covering(tokens_for(frames)), Pose2D(), [], [], [], kept)
        return self._made(state, prompt, guide, samples, torch.Generator().manual_seed(seed), progress)

    def _made(
        self,
        state: _State,
        prompt: str,
        guide: Guide | None,
        samples: int,
        draw: torch.Generator,
        progress: Progress | None,
    ) -> Generation:
        """Algorithm 3."""
        self._draw_tokens(state, self._text(prompt, samples * state.windows.count), guide, draw, progress)
        trace: dict[str, object] = {"tilt_kl_nats": state.moved, "frames": state.frames}
        if guide is None:
            return Generation(self._decode(state, state.refined), None, trace)
        drawn, latent = self._refinable(state)
        found = guide.refine(drawn)
        trace["refinement_moved_latent"] = _moved(latent(drawn.value), latent(found))
        if torch.equal(found, drawn.value):  # to the last bit what it would be without a guide
            motion = self._decode(state, state.refined)
            return guide.finish(Generation(motion, motion, trace))
        return guide.finish(Generation(drawn.at(found).motion, drawn.motion, trace))

    def _frames(self, prompt: str, seconds: float, samples: int) -> int:
        shortest = MIN_FRAMES / FPS
        if not prompt.strip():
            raise UserError("the prompt is empty; describe the motion in a sentence, such as 'a person walks'")
        if not shortest <= seconds <= MAX_SECONDS:
            raise UserError(f"seconds is {seconds:g}; a motion lasts from {shortest:g} to {MAX_SECONDS:g} s")
        if samples < 1:
            raise UserError(f"samples is {samples}; ask for at least 1")
        return round(seconds * FPS)

    def _text(self, prompt: str, samples: int) -> TextFeatures:
        """The prompt for every sample, then 'no text' for every sample (classifier-free guidance)."""
        one = self.bundle.text.encode([prompt.lower().strip()] * 2)
        pair = self.bundle.transformer.without_text(one, torch.tensor([False, True]))
        return TextFeatures(*(torch.repeat_interleave(x, samples, 0) for x in (pair.sentence, pair.words, pair.mask)))

    def _draw_tokens(
        self, state: _State, text: TextFeatures, guide: Guide | None, draw: torch.Generator, progress: Progress | None
    ) -> None:
        cache = Cache()
        for k in range(self.quantiser.scales):
            if progress is not None:
                progress("tokens", k / self.quantiser.scales)
            logits = self._prior(state, text, k, cache)
            if guide is not None:
                logits = self._tilted(state, logits, k, guide)
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
    def _prior(self, state: _State, text: TextFeatures, k: int, cache: Cache) -> Float[Tensor, "S L_k V"]:
        """Log-probabilities of scale k's tokens given text and coarser tokens."""
        twice = [torch.cat([e, e]) for e in map(state.windows.rows, state.codes)]
        both = self.bundle.transformer.predict(self.quantiser, text, twice, k, state.finest, cache)
        told, untold = both.chunk(2)
        logits = untold + self.sampling.cfg * (told - untold)
        return state.windows.series((logits / self.sampling.temperature).log_softmax(-1))

    def _tilted(self, state: _State, prior: Float[Tensor, "S L_k V"], k: int, guide: Guide) -> Float[Tensor, "S L_k V"]:
        """First-order posterior of scale k (Eq. 9 to 11)."""
        codes = self.quantiser.codes(k)
        mean = prior.exp() @ codes
        step = self._scale_step(state, mean, k)
        first_order = guide.gradient(step) @ codes.T
        nats = self.sampling.clip_at(k, self.quantiser.scales, len(prior)).to(prior)
        if self.observer is not None:
            self.observer(Tilt(k, step, prior, first_order, codes, nats))
        posterior = (prior + clipped(first_order, nats[:, None, None])).log_softmax(-1)
        state.moved.append(float((posterior.exp() * (posterior - prior)).sum(-1).mean()))
        return posterior

    def _decode(self, state: _State, embeddings: list[Float[Tensor, "S _L_k d"]]) -> Motion:
        """World motion of embeddings, for as many scales as there are (algorithm 2)."""
        return self._placed(state, self.bundle.tokenizer.decode_latent(self._latent(state, embeddings)))

    def _placed(self, state: _State, features: Float[Tensor, "S T c"]) -> Motion:
        """World motion of features, without the frames that nobody asked for."""
        motion = Motion(features_to_joints(features[:, : state.frames]), fps=FPS)
        return motion.placed(state.start) if state.kept is None else state.kept.placed(motion)

    def _step(self, state: _State, value: Tensor, latent: Callable[[Tensor], Tensor]) -> Step:
        """A step whose value leads to the latent of the whole motion."""
        place = partial(self._placed, state)
        return LatentStep(value, self.bundle.tokenizer, latent, place, self._rough)

    def _scale_step(self, state: _State, value: Float[Tensor, "S M d"], k: int) -> Step:
        """A step whose value holds the embeddings of scale k, the next one."""
        now = replace(state)  # however far the drawing goes on
        return self._step(state, value, lambda e: now.windows.join(self._onto(now, e, k)))

    def _onto(self, state: _State, e: Float[Tensor, "S M d"], k: int) -> Float[Tensor, "R d L"]:
        """Latent of every window with the embeddings of scale k, the next one, on top of what is refined."""
        own = self.quantiser.up(k, state.windows.rows(e), state.finest)
        return own if state.latent is None else state.latent + own

    def _latent(self, state: _State, embeddings: list[Float[Tensor, "S _M d"]]) -> Float[Tensor, "S d N"]:
        """Latent of the whole motion, for as many scales as there are."""
        windows = state.windows
        return windows.join(self.quantiser.latent([windows.rows(e) for e in embeddings], state.finest))

    def _refinable(self, state: _State) -> tuple[Step, Callable[[Tensor], Tensor]]:
        """Continuous residuals of all scales at once (Eq. 12), in the metric of the decoder, and their latent."""
        lengths, metric = [e.shape[1] for e in state.refined], self.bundle.metric
        value = torch.cat(state.refined if metric is None else metric.coordinates(state.refined), dim=1)

        def latent(value: Float[Tensor, "S M d"]) -> Tensor:
            parts = list(value.split(lengths, dim=1))
            return self._latent(state, parts if metric is None else metric.embeddings(parts))

        return self._step(state, value, latent), latent


@torch.no_grad()
def _moved(before: Float[Tensor, "S d N"], after: Float[Tensor, "S d N"]) -> list[float]:
    """How far refinement moved each latent, relative to its size: small where guidance did its work."""
    found: list[float] = ((after - before).flatten(1).norm(dim=1) / before.flatten(1).norm(dim=1)).tolist()
    return found


def clipped(tilt: Float[Tensor, "*b V"], nats: float | Tensor) -> Float[Tensor, "*b V"]:
    """The tilt scaled down where its spread over the codes exceeds `nats` (one, or ``[*b, 1]``); 0 leaves it alone."""
    spread = tilt.amax(-1, keepdim=True) - tilt.amin(-1, keepdim=True)
    most = torch.as_tensor(nats, dtype=tilt.dtype)
    return tilt * torch.where(most > 0, (most / spread.clamp_min(1e-12)).clamp_max(1.0), 1.0)


def exact_tilt(step: Step, guide: Guide, codes: Float[Tensor, "V d"], position: int) -> Float[Tensor, "S V"]:
    """Log-likelihood of the goals for every code at one position, the others at their means (Eq. 9, V decodes)."""
    rows = []
    for code in codes:
        value = step.value.clone()
        value[:, position] = code
        rows.append(guide.log_prob(step.at(value)))
    return torch.stack(rows, dim=-1)


def _sample(logits: Float[Tensor, "S L V"], top_p: float, draw: torch.Generator) -> Int[Tensor, "S L"]:
    """Tokens from the nucleus of each position's distribution."""
    p = logits.softmax(-1)
    ordered, index = p.sort(-1, descending=True)
    outside = ordered.cumsum(-1) - ordered >= top_p
    ordered = ordered.masked_fill(outside, 0.0)
    picks = torch.multinomial(ordered.flatten(0, 1), 1, generator=draw).unflatten(0, logits.shape[:2])
    return index.gather(-1, picks).squeeze(-1)
