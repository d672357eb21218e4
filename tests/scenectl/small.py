"""Networks and people small enough for tests: random weights, walks written as formulas."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.data.features import joints_to_features, rotation_about_y
from scenectl.generators.mscot.bundle import Bundle, build
from scenectl.generators.mscot.config import ModelConfig, RefinerConfig, TokenizerConfig, TransformerConfig
from scenectl.generators.mscot.networks.tokenizer import Quantiser
from scenectl.networks.text import TextFeatures
from scenes.motion.skeleton import HUMANML3D

SCALES = (1, 2, 3, 5)
TOKENIZER = TokenizerConfig(width=16, depth=2, code_dim=16, codes=16, scales=SCALES, scale_convs=3)
TRANSFORMER = TransformerConfig(width=16, layers=2, heads=2, text_dim=6)
REFINER = RefinerConfig(width=16, layers=1, heads=2)


def config(**changes: object) -> ModelConfig:
    """A tiny model; `prefix`, `normalised` and `down` can be chosen."""
    tokenizer = TOKENIZER.model_copy(update={k: v for k, v in changes.items() if k in TokenizerConfig.model_fields})
    transformer = TRANSFORMER.model_copy(
        update={k: v for k, v in changes.items() if k in TransformerConfig.model_fields and k != "width"}
    )
    return ModelConfig(name="small", text="none", tokenizer=tokenizer, transformer=transformer, refiner=REFINER)


class Words:
    """A text encoder whose features are random but fixed for each word."""

    name, dim = "words", 6

    def encode(self, prompts: list[str]) -> TextFeatures:
        split = [prompt.split() for prompt in prompts]
        longest = max(len(words) for words in split)
        features = torch.zeros(len(prompts), longest, self.dim)
        mask = torch.zeros(len(prompts), longest, dtype=torch.bool)
        for i, words in enumerate(split):
            for j, word in enumerate(words):
                draw = torch.Generator().manual_seed(sum(ord(c) * 31**n for n, c in enumerate(word)) % 2**31)
                features[i, j] = torch.randn(self.dim, generator=draw)
            mask[i, : len(words)] = True
        return TextFeatures(features.sum(1) / mask.sum(1, keepdim=True), features, mask)


def quantiser(**changes: object) -> Quantiser:
    """A quantiser with gains that fall from scale to scale, as trained ones do."""
    torch.manual_seed(1)
    made = Quantiser(config(**changes).tokenizer)
    made.gain.copy_(torch.linspace(3.0, 1.0, len(SCALES)))
    if not made.config.normalised:  # codes of all sizes, as free ones are
        made.codebook.mul_(torch.linspace(0.3, 3.0, 16)[:, None])
        made.sums.copy_(made.codebook)
    return made.eval()


def bundle(seed: int = 0, **changes: object) -> Bundle:
    """Random networks in a bundle; the refiner moves tokens a little, and features have a person's size."""
    torch.manual_seed(seed)
    settings = config(**changes)
    tokenizer, transformer, refiner = build(settings)
    rows = joints_to_features(walk(64))
    tokenizer.mean.copy_(rows.mean(0))
    tokenizer.std.fill_(0.3)
    tokenizer.std[:1], tokenizer.std[1:3] = 0.03, 0.1
    tokenizer.quantiser.gain.copy_(torch.linspace(3.0, 1.0, len(SCALES)))
    torch.nn.init.normal_(refiner.outward.weight, std=0.05)
    for block in transformer.blocks:  # branches start near zero, which would hide what they compute
        for linear in (block.self_attention.out, block.cross_attention.out, block.feed[2]):
            torch.nn.init.normal_(linear.weight, std=0.3)
    torch.nn.init.normal_(transformer.no_sentence, std=0.5)
    torch.nn.init.normal_(transformer.no_word, std=0.5)
    for network in (tokenizer, transformer, refiner):
        network.eval().requires_grad_(False)
    return Bundle(settings, tokenizer, transformer, refiner, Words(), "CC0-1.0")


def double(made: Bundle) -> Bundle:
    """The bundle in double precision, for comparisons with finite differences."""
    for network in (made.tokenizer, made.transformer, made.refiner):
        network.double()
    return replace(made)


def walk(frames: int, speed: float = 1.2, turn: float = 0.0, sway: float = 0.3) -> Float[Tensor, "T 22 3"]:
    """A stick figure that walks along +z (or an arc, `turn` rad in all), bones of the uniform lengths, feet planted.

    The stance ankle stays where it is: legs are solved by inverse kinematics from hips that ride along.
    """
    time = torch.arange(frames, dtype=torch.float64) / 20
    rest = torch.tensor(HUMANML3D.offsets, dtype=torch.float64)
    lengths = rest.norm(dim=-1)
    joints = torch.zeros(frames, 22, 3, dtype=torch.float64)
    joints[:, 0, 1], joints[:, 0, 2] = 0.90, speed * time
    for j in range(1, 22):
        direction = (rest[j] / lengths[j]).expand(frames, 3).clone()
        if j in (18, 19, 20, 21):  # arms hang, and swing
            direction = torch.tensor([[0.0, -1.0, 0.0]], dtype=torch.float64).repeat(frames, 1)
            direction[:, 2] += sway * torch.sin(2 * math.pi * time + (math.pi if j % 2 else 0.0))
        joints[:, j] = joints[:, HUMANML3D.parents[j]] + direction / direction.norm(dim=-1, keepdim=True) * lengths[j]
    for hip, knee, ankle, foot, phase in ((1, 4, 7, 10, 0.0), (2, 5, 8, 11, 0.5)):
        _step(joints, time, speed, (hip, knee, ankle, foot), phase, lengths)
    if turn:
        joints = joints @ rotation_about_y(torch.tensor(-turn, dtype=torch.float64))
    return joints.float()


def _step(
    joints: Tensor, time: Tensor, speed: float, leg: tuple[int, int, int, int], phase: float, sizes: Tensor
) -> None:
    """Put one leg on its footprints: half of each second on the floor, half in the air."""
    hip, knee, ankle, foot = leg
    cycle = time + phase
    inside = cycle - cycle.floor()
    stance = (cycle.floor() - phase) * speed + 0.25 * speed
    swing = ((inside - 0.5) / 0.5).clamp_min(0.0)
    smooth = swing * swing * (3 - 2 * swing)
    x = joints[:, hip, 0]
    y = 0.08 + 0.1 * torch.sin(math.pi * swing)
    joints[:, ankle] = torch.stack([x, y, stance + smooth * speed], dim=-1)
    down = joints[:, ankle] - joints[:, hip]
    reach = down.norm(dim=-1).clamp_max(float(sizes[knee] + sizes[ankle]) - 1e-4)
    joints[:, ankle] = joints[:, hip] + down / down.norm(dim=-1, keepdim=True) * reach[:, None]
    along = (sizes[knee] ** 2 - sizes[ankle] ** 2 + reach**2) / (2 * reach)
    bend = (sizes[knee] ** 2 - along**2).clamp_min(0.0).sqrt()
    axis = down / down.norm(dim=-1, keepdim=True)
    front = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64) - axis[:, 2:] * axis
    front = front / front.norm(dim=-1, keepdim=True)
    joints[:, knee] = joints[:, hip] + axis * along[:, None] + front * bend[:, None]
    toe = torch.tensor([0.0, -0.06, 1.0], dtype=torch.float64)
    joints[:, foot] = joints[:, ankle] + toe / toe.norm() * sizes[foot]
