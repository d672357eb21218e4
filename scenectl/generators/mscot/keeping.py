"""Tokens that shall say what is known already: a neighbour's overlap, or the part of a motion that an edit keeps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from scenectl.data.features import joints_to_features
from scenectl.generators.mscot.networks.tokenizer import Quantiser, Tokenizer
from scenectl.generators.mscot.schedule import DOWNSAMPLING, MAX_FRAMES, tokens_for
from scenectl.generators.windows import Windows
from scenes.motion.headings import rotation_about_y
from scenes.motion.motion import Motion

LONGEST = MAX_FRAMES // DOWNSAMPLING
"""Tokens of the longest window at the finest scale."""

OVERLAP = 10
"""Tokens that neighbours share at least (2 s): a whole stride, in which steps can fall into line."""

WHOLE = 0.5
"""Interpolated share of a token above which it is replaced by the original's (MoSa, section IV-D)."""


def share_at(quantiser: Quantiser, k: int, share: Float[Tensor, "*b n"]) -> Float[Tensor, "*b L_k"]:
    """A weight over the finest scale's tokens, interpolated to scale k as the residuals are."""
    length = quantiser.lengths(share.shape[-1])[k]
    flat: Tensor = quantiser.down(share.reshape(-1, 1, share.shape[-1]), length)
    return flat.reshape(*share.shape[:-1], length)


def closeness(
    quantiser: Quantiser, k: int, rest: Float[Tensor, "B d n"], share: Float[Tensor, "B n"]
) -> Float[Tensor, "B L_k V"]:
    """Log-likelihood of every code of scale k, up to a constant, where part of the latent is known.

    The known part is seen through Gaussian noise as large as the scale's codes: minus half of
    ``m |u - c|^2 / mean |c|^2`` for code c, where m is the interpolated share and u what the scale is to add. The
    code that comes first is the one that quantisation would take (Eq. 34); nothing known is 0 for all.

    Args:
        quantiser: of the model.
        k: the scale, from 0.
        rest: what the coarser scales lack of the known latent, times `share`.
        share: how much is known of each token of the finest scale, 0 to 1.
    """
    codes = quantiser.codes(k)
    lengths = quantiser.lengths(rest.shape[-1])
    wanted: Tensor = quantiser.down(rest, lengths[k]).transpose(1, 2)
    size = codes.square().sum(-1)
    weighted = share_at(quantiser, k, share)[..., None] * size
    return (wanted @ codes.T - weighted / 2) / size.mean()


@dataclass(frozen=True)
class Kept:
    """What an edit keeps of a motion, seen as tokens (MoSa, section IV-D).

    Attributes:
        latent: the encoder's, of the motion with what is to be made anew filled in, ``[S, d, N]``; S is 1, or there is
            a motion for each sample.
        share: 1 for tokens of which all frames are kept, else 0, ``[1, N]``.
        anchor: a kept frame, at which what is decoded is laid onto the original.
        pose: the original's joints there, world, ``[S, 22, 3]``.
        floor: height (m) of the original's lowest joint, ``[S]``.
        t0: time (s) of the original's first frame.
    """

    latent: Float[Tensor, "S d N"]
    share: Float[Tensor, "1 N"]
    anchor: int
    pose: Float[Tensor, "S 22 3"]
    floor: Float[Tensor, " S"]
    t0: float = 0.0

    @classmethod
    @torch.no_grad()
    def of(cls, tokenizer: Tokenizer, motion: Motion, regenerate: Bool[Tensor, " T"]) -> Kept:
        """Encode one motion, ``[T, 22, 3]``, or one for each sample, ``[S, T, 22, 3]``."""
        frames, kept = motion.frames, ~regenerate
        filled = [bridged(joints, regenerate) for joints in motion.joints.reshape(-1, frames, 22, 3)]
        missing = tokens_for(frames) * DOWNSAMPLING + 1 - frames
        latent = tokenizer.latent(torch.stack([joints_to_features(_onward(joints, missing)) for joints in filled]))
        padded = torch.cat([kept, kept[-1:].expand(missing - 1)])
        share = padded.unflatten(0, (-1, DOWNSAMPLING)).all(-1).to(latent)[None]
        edges = torch.nonzero(kept[:-1] != kept[1:]).flatten()
        first = int(edges[0])
        anchor = first if kept[first] else first + 1
        pose, lowest = torch.stack([joints[anchor] for joints in filled]), [float(j[..., 1].min()) for j in filled]
        return cls(latent, share, anchor, pose, pose.new_tensor(lowest), motion.t0)

    def closeness(
        self, quantiser: Quantiser, coarser: list[Float[Tensor, "S _L_j d"]], samples: int
    ) -> Float[Tensor, "S L_k V"]:
        """Log-likelihood of every code of the next scale; see the function of this name."""
        rest = self.latent.expand(samples, -1, -1)
        if coarser:
            rest = rest - quantiser.latent(coarser, rest.shape[-1])
        return closeness(quantiser, len(coarser), rest * self.share[:, None], self.share.expand(samples, -1))

    def replaced(
        self, quantiser: Quantiser, tokens: Int[Tensor, "S L_k"], close: Float[Tensor, "S L_k V"], k: int
    ) -> Int[Tensor, "S L_k"]:
        """The tokens, those of the original where it is kept."""
        return torch.where(share_at(quantiser, k, self.share) > WHOLE, close.argmax(-1), tokens)

    def take(self, samples: Int[Tensor, " s"]) -> Kept:
        """The same of some samples."""
        if len(self.pose) == 1:
            return self
        return replace(self, latent=self.latent[samples], pose=self.pose[samples], floor=self.floor[samples])

    def placed(self, motion: Motion) -> Motion:
        """Canonical motions moved and turned to fit at the anchor frame, on its clock.

        They are ``[S, T, 22, 3]``, or as many times S, one S after the other.
        """
        times = len(motion.joints) // len(self.pose)
        here, there = motion.joints[:, self.anchor], self.pose.to(motion.joints).repeat(times, 1, 1)
        foot, goal = here[:, :1] * here.new_tensor([1.0, 0.0, 1.0]), there[:, :1] * there.new_tensor([1.0, 0.0, 1.0])
        a, b = here - foot, there - goal
        cross = (b[..., 0] * a[..., 2] - b[..., 2] * a[..., 0]).sum(-1)
        dot = (b[..., 0] * a[..., 0] + b[..., 2] * a[..., 2]).sum(-1)
        turn = rotation_about_y(torch.atan2(cross, dot))[:, None, None]
        moved = (turn * (motion.joints - foot[:, None])[..., None, :]).sum(-1)
        up = goal.new_tensor([0.0, 1.0, 0.0]) * self.floor.to(goal).repeat(times)[:, None, None]
        return replace(motion, joints=moved + (goal + up)[:, None], t0=self.t0)


def _onward(joints: Float[Tensor, "T 22 3"], frames: int) -> Float[Tensor, "N 22 3"]:
    """Joints that go on as in the last step for some frames more."""
    steps = torch.arange(1, frames + 1, device=joints.device)[:, None, None]
    return torch.cat([joints, joints[-1:] + steps * (joints[-1:] - joints[-2:-1])])


def bridged(joints: Float[Tensor, "T J 3"], gone: Bool[Tensor, " T"]) -> Float[Tensor, "T J 3"]:
    """Straight lines between the frames that stay, and the nearest one before the first and after the last."""
    stay = torch.nonzero(~gone).flatten()
    at = torch.arange(len(joints), device=joints.device)
    after = torch.searchsorted(stay, at).clamp_max(len(stay) - 1)
    before = (torch.searchsorted(stay, at, right=True) - 1).clamp_min(0)
    low, high = stay[before], stay[after]
    part = ((at - low) / (high - low).clamp_min(1)).clamp(0, 1).to(joints)[:, None, None]
    return joints[low] + part * (joints[high] - joints[low])


def covering(tokens: int) -> Windows:
    """The windows over a motion of so many tokens at the finest scale."""
    return Windows.covering(tokens, LONGEST, OVERLAP)


@torch.no_grad()
def in_turns(
    windows: Windows,
    quantiser: Quantiser,
    prior: Float[Tensor, "R L_k V"],
    coarser: list[Float[Tensor, "R _L_j d"]],
    sample: Callable[[Tensor, Tensor], Int[Tensor, "R L_k"]],
) -> Int[Tensor, "R L_k"]:
    """Tokens of one scale, R = S x W windows: every second window first, then those between.

    A window that has not drawn yet is taken at its prior's mean, so that the first know what the others are likely to
    do and the others know what the first have done.

    Args:
        windows: how the motion is covered.
        quantiser: of the model.
        prior: logits of this scale.
        coarser: embeddings of the scales before.
        sample: draws tokens for logits and every code's closeness to the neighbours (nats).
    """
    k, shape = len(coarser), (len(prior), quantiser.config.code_dim, windows.length)
    done = quantiser.latent(coarser, windows.length) if coarser else prior.new_zeros(shape)
    others = windows.others.to(prior).repeat(len(prior) // windows.count, 1)
    odd = (torch.arange(len(prior), device=prior.device) % windows.count % 2 == 1)[:, None]
    likely = prior.softmax(-1) @ quantiser.codes(k)
    tokens = torch.zeros(prior.shape[:2], dtype=torch.long, device=prior.device)
    for turn in (~odd, odd):
        ahead = done + quantiser.up(k, likely, windows.length)
        rest = windows.disagreement(torch.where(turn[..., None], done, ahead))
        drawn = sample(prior, closeness(quantiser, k, rest, others))
        tokens = torch.where(turn, drawn, tokens)
        likely = torch.where(turn[..., None], quantiser.lookup(k, drawn), likely)
    return tokens
