"""What the processor multiplies fast."""

from __future__ import annotations

from pathlib import Path

_BFLOAT16_FLAGS = {"avx512_bf16", "amx_bf16"}


def cpu_has_bfloat16(facts: Path = Path("/proc/cpuinfo")) -> bool:
    """Whether the CPU multiplies in bfloat16; without such instructions it is slower than float32."""
    try:
        words = facts.read_text().split()
    except OSError:
        return False  # not a Linux: float32 works everywhere
    return not _BFLOAT16_FLAGS.isdisjoint(words)
