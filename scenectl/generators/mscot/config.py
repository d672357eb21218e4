"""Sizes of the networks; the defaults are the published ones (appendix B.2)."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from scenes.tables import Table

BASE_SCALES = (1, 2, 3, 4, 5, 6, 8, 10, 13, 16)
"""Tokens at each scale for 64 frames (MSCoT, appendix B.2)."""


Width = Annotated[int, Field(ge=1, le=2**14)]
Count = Annotated[int, Field(ge=1, le=256)]
"""Bounded, as a configuration comes from a file; what memory it may take is decided by the size of that file."""


def _growing(scales: tuple[int, ...]) -> tuple[int, ...]:
    if any(a > b for a, b in pairwise(scales)):
        raise ValueError(f"scales must never decrease, not {list(scales)}")
    return scales


Scales = Annotated[tuple[Count, ...], Field(min_length=1, max_length=64), AfterValidator(_growing)]


class _Attentive(Table):
    """Width and heads of a network whose tokens attend to one another, at places that sinusoids tell."""

    width: Width
    heads: Count

    @model_validator(mode="after")
    def _divisible(self) -> _Attentive:
        if self.width < 4 or self.width % 2 or self.width % self.heads:
            raise ValueError(f"width is {self.width}; give an even multiple of the {self.heads} heads, from 4 on")
        return self


class TokenizerConfig(Table):
    """Multi-scale VQ-VAE.

    Attributes:
        width: channels of the convolutional encoder and decoder.
        depth: residual blocks at each resolution, dilations growing by `dilation_growth`.
        code_dim: d, dimension of a code.
        codes: V, size of the codebook.
        shared_codebook: all scales use one codebook; otherwise each has V codes of its own (Table 8).
        scales: base schedule L_1..L_K; the last one belongs to `scales[-1] * 4` frames.
        scale_convs: convolutions shared by the K scales, assigned in order.
        normalised: l2-normalise codes (Prop. 1's remark) with one learned gain per scale.
        down: how residuals are brought to a coarser scale.
        shortcut: encoder and decoder add a linear map between four frames and their latent, which starts at the
            principal components of the data (`scenectl bench tokenizer`); the paper has none.
    """

    width: Width = 512
    depth: Annotated[int, Field(ge=0, le=8)] = 3
    dilation_growth: Annotated[int, Field(ge=1, le=8)] = 3
    code_dim: Width = 512
    codes: Annotated[int, Field(ge=1, le=2**17)] = 1024
    shared_codebook: bool = True
    scales: Scales = BASE_SCALES
    scale_convs: Count = 8
    normalised: bool = True
    down: Literal["linear", "area"] = "linear"
    shortcut: bool = False


class TransformerConfig(_Attentive):
    """Scale-wise transformer.

    Attributes:
        width, layers, heads: the usual.
        text_dim: dimension of the text encoder's features.
        dropout: on attention and feed-forward outputs.
        prefix: what a scale sees of the one before: its codes alone (the paper), or the sum of all scales so far.
    """

    width: Width = 384
    layers: Count = 6
    heads: Count = 6
    text_dim: Width = 512
    dropout: Annotated[float, Field(ge=0, lt=1)] = 0.1
    prefix: Literal["previous", "cumulative"] = "previous"


class RefinerConfig(_Attentive):
    """Token refiner: a small network over the tokens of one scale.

    Attributes:
        width, layers, heads: the usual; heads are the transformer's.
        kind: a transformer encoder, or a perceptron that looks at every token alone (Table 14).
    """

    width: Width = 256
    layers: Count = 2
    heads: Count = 4
    kind: Literal["transformer", "mlp"] = "transformer"


class ModelConfig(Table):
    """All three networks and the text encoder they were trained with."""

    name: str
    text: str = "minilm"
    tokenizer: TokenizerConfig
    transformer: TransformerConfig
    refiner: RefinerConfig
