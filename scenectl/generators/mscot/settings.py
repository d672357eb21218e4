"""What MSCoT can do, and how it draws its tokens, as it stands in a task's [generator]."""

from __future__ import annotations

from pydantic import Field

from scenectl.data.features import FPS
from scenectl.generators.mscot.schedule import MAX_FRAMES, MIN_FRAMES
from scenectl.generators.spec import Spec
from scenes.tables import Table

SPEC = Spec(
    fps=FPS,
    shortest=MIN_FRAMES / FPS,
    longest=120.0,  # beyond this a request is taken for a mistake; the schedule itself has no limit
    window=MAX_FRAMES / FPS,
    abilities=frozenset({"edit", "sentences"}),
)


class Sampling(Table):
    """How tokens are drawn.

    Attributes:
        cfg: classifier-free guidance weight on the logits, before any goal (the paper: 5). More follows rare words of
            a sentence better, such as "ducks", and makes feet slide.
        cfg_coarsest: how many times `cfg` that weight is at the coarsest scale, where a window is told several
            sentences (`sampling.cfg_at`). More does all acts of a sentence more often, up to about here
            (`scenectl bench sentences`); people who are told to stand would sway too little by it.
        temperature: of the softmax; below a thousandth the likeliest token would be drawn every time.
        top_p: smallest set of tokens with this share of what is drawn from (the prior, tilted where there are goals)
            is kept; 1 keeps all.
        clip_nats: largest spread of a position's tilt between codes (nats) at the finest scale: an unclipped tilt can
            overrule the prior altogether, so that a walker whose goal is behind a free start goes backwards. Coarser
            scales may be tilted less (`posterior.clip_at`). 0 leaves tilts as they are.
        clip_coarsest: share of that spread for the coarsest scale of the first sample.
    """

    cfg: float = Field(default=2.0, ge=0)
    cfg_coarsest: float = Field(default=2.5, ge=0)
    temperature: float = Field(default=0.7, ge=1e-3)
    top_p: float = Field(default=0.95, ge=1e-6, le=1)
    clip_nats: float = Field(default=12.0, ge=0)
    clip_coarsest: float = Field(default=0.4, gt=0, le=1)
