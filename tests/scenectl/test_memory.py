"""The memory of a process stays where it is, however many motions of however many lengths it makes."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from scenectl.generators.weights import bundled_weights

DECODE = """
import os
import scenectl
import torch
from scenectl.generators.mscot.bundle import load_bundle
from scenectl.generators.weights import described, weights_folder

torch.set_num_threads(1)
tokenizer = load_bundle(described(weights_folder("default"))).tokenizer
latent = tokenizer.config.code_dim

def decode(samples, tokens):
    with torch.no_grad():
        tokenizer.decoder(torch.zeros(samples, latent, tokens))

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

for samples in (8, 7):
    decode(samples, 49)
before = resident()
for samples in range(1, 9):
    for tokens in range(9, 50):
        decode(samples, tokens)
print(resident() - before)
"""


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="Linux tells how much memory is in use")
@pytest.mark.skipif("default" not in bundled_weights(), reason="needs the weights that ship")
def test_code_that_is_compiled_for_each_shape_is_not_kept_for_ever() -> None:
    plain = {key: value for key, value in os.environ.items() if not key.startswith("ONEDNN_")}
    done = subprocess.run([sys.executable, "-c", DECODE], capture_output=True, text=True, check=True, env=plain)
    assert float(done.stdout) < 45.0  # 21 MB for 328 shapes; 78 MB with the 1,024 that oneDNN keeps by itself
