"""What every test gets: one thread, a fixed seed, and the way to the shared data where it exists."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

import tests.checks  # noqa: F401  # which --jaxtyping-packages names

SHARED = Path(__file__).resolve().parents[1].parent / "shared"


@pytest.fixture(autouse=True)
def _deterministic() -> None:
    torch.set_num_threads(1)  # small tensors run best on one thread, and results do not depend on the machine
    torch.manual_seed(0)
    np.random.seed(0)  # noqa: NPY002  # for libraries that draw from the global generator


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Bakes of the tests go to a folder of their own, so that an old cache never hides a fault.

    The processes of one run share it: each has its folder beside those of the others.
    """
    import os

    own = tmp_path_factory.getbasetemp()
    cache = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "cache"
    cache.mkdir(exist_ok=True)
    os.environ["SCENECTL_CACHE"] = str(cache)


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder with scans, motion capture and the reference clip, which lies beside the repository."""
    if not SHARED.is_dir():
        pytest.skip(f"needs the shared data in {SHARED}, which is not here")
    return SHARED
