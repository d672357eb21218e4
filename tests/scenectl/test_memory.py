"""The memory of a process stays where it is, however many motions of however many lengths it makes."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from scenectl.generators.weights import bundled_weights

MEASURE = """
import os
import scenectl
import torch

torch.set_num_threads(1)

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
"""

CONVOLUTIONS = """
from scenectl.generators.mscot.bundle import load_bundle
from scenectl.generators.weights import described, weights_folder

tokenizer = load_bundle(described(weights_folder("default"))).tokenizer
latent = tokenizer.config.code_dim

def compute(samples, tokens):
    with torch.no_grad():
        tokenizer.decoder(torch.zeros(samples, latent, tokens))
"""

PRODUCTS = """
weight = torch.zeros(128, 128, dtype=torch.bfloat16)

def compute(samples, tokens):
    torch.zeros(samples * 41 + tokens + 50, 128, dtype=torch.bfloat16) @ weight
"""

EACH_SHAPE = """
for samples in (8, 7):
    compute(samples, 49)
before = resident()
for samples in range(1, 9):
    for tokens in range(9, 50):
        compute(samples, tokens)
print(resident() - before)
"""


def grown(compute: str) -> float:
    """MB by which a process grows that computes 328 shapes, with the settings that `import scenectl` makes."""
    plain = {key: value for key, value in os.environ.items() if not key.startswith(("ONEDNN_", "LRU_"))}
    code = [sys.executable, "-c", MEASURE + compute + EACH_SHAPE]
    return float(subprocess.run(code, capture_output=True, text=True, check=True, env=plain).stdout)


linux = pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="Linux tells how much memory is in use")


@linux
@pytest.mark.skipif("default" not in bundled_weights(), reason="needs the weights that ship")
def test_code_that_is_compiled_for_each_shape_is_not_kept_for_ever() -> None:
    assert grown(CONVOLUTIONS) < 45.0  # 21 MB; 78 MB with the 1,024 that oneDNN keeps by itself


@linux
def test_plans_of_products_of_each_shape_are_not_kept_for_ever() -> None:
    assert grown(PRODUCTS) < 80.0  # 32 MB; 158 MB with the 1,024 that torch keeps by itself
