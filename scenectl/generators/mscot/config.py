"""Sizes of the networks; the defaults are the published ones (appendix B.2)."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict

BASE_SCALES = (1, 2, 3, 4, 5, 6, 8, 10, 13, 16)
"""Tokens at each scale for 64 frames (MSCoT, appendix B.2)."""


class TokenizerConfig(BaseModel):
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
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    width: int = 512
    depth: int = 3
    dilation_growth: int = 3
    code_dim: int = 512
    codes: int = 1024
    shared_codebook: bool = True
    scales: tuple[int, ...] = BASE_SCALES
    scale_convs: int = 8
    normalised: bool = True
    down: Literal["linear", "area"] = "linear"


class TransformerConfig(BaseModel):
    """Scale-wise transformer.

    Attributes:
        width, layers, heads: the usual.
        text_dim: dimension of the text encoder's features.
        dropout: on attention and feed-forward outputs.
        prefix: what a scale sees of the one before: its codes alone (the paper), or the sum of all scales so far.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    width: int = 384
    layers: int = 6
    heads: int = 6
    text_dim: int = 512
    dropout: float = 0.1
    prefix: Literal["previous", "cumulative"] = "previous"


class RefinerConfig(BaseModel):
    """Token refiner: a small network over the tokens of one scale.

    Attributes:
        width, layers, heads: the usual; heads are the transformer's.
        kind: a transformer encoder, or a perceptron that looks at every token alone (Table 14).
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    width: int = 256
    layers: int = 2
    heads: int = 4
    kind: Literal["transformer", "mlp"] = "transformer"


class ModelConfig(BaseModel):
    """All three networks and the text encoder they were trained with."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    text: str = "minilm"
    tokenizer: TokenizerConfig
    transformer: TransformerConfig
    refiner: RefinerConfig
