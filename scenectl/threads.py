"""How many threads torch computes with, and how they wait.

Torch computes with OpenMP, whose threads spin while they wait for each other: a thread that has lost its core to
another process makes all others wait, at each of the thousands of small operations of a generation. One thread waits
for none: motions are made on one unless more are asked for. Training keeps its threads, which pays for large networks
(`train --threads 1` for small ones), and lets them sleep while they wait, which gives their cores away; OpenMP reads
how threads wait once, when torch is imported. `scenectl bench threads` prints what each choice costs.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from scenes.errors import UserError

MOST = 256
"""Threads at most: more than any machine has cores that we know of, and fewer than make torch's pool fail."""

_asked: ContextVar[int] = ContextVar("threads that an outer block or `use` asked for", default=1)


@contextmanager
def threads(number: int | None = None) -> Iterator[int]:
    """Within the block, torch computes with so many threads; after it, with as many as before.

    Args:
        number: threads; None takes what a block around this one or `use` asked for, and one where neither did: the
            tensors of a generation are small, and one thread's results do not depend on how many cores there are.

    Yields:
        The number in force.

    Raises:
        UserError: a number that cannot be.
    """
    import torch

    number = checked(_asked.get() if number is None else number)
    before, token = torch.get_num_threads(), _asked.set(number)
    torch.set_num_threads(number)
    try:
        yield number
    finally:
        torch.set_num_threads(before)
        _asked.reset(token)


def use(number: int) -> None:
    """From now on torch computes with so many threads, in blocks of `threads` that ask for none of their own, too."""
    import torch

    torch.set_num_threads(checked(number))
    _asked.set(number)


def checked(number: int) -> int:
    """A number of threads; raises UserError for one that cannot be."""
    if not 1 <= number <= MOST:
        raise UserError(f"threads is {number}; give 1 to {MOST}")
    return number


def sleep_while_waiting() -> None:
    """Let threads sleep while they wait, unless the environment says how; has an effect before torch is imported."""
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
