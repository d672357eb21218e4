"""Loops over voxels, triangles and points, compiled by numba.

A kernel takes and returns plain arrays and numbers, allocates little, and holds no lock: `parts` runs several on
threads of their own. What a kernel means is said by the function of `scenes` that calls it; nothing here is public.
Compiled code is cached on disk, so that each machine compiles once, and again when any file of this folder changes.
numba itself is imported when a kernel is first called.
"""

from __future__ import annotations

import hashlib
import inspect
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache, cached_property, update_wrapper
from pathlib import Path
from threading import RLock
from typing import Any


def _digest() -> str:
    """Of the sources of all kernels."""
    sources = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:8]


_VERSION = _digest()


_LOCK = RLock()


class _Disk:
    """numba's cache on disk of a function's machine code, where what fails costs time and nothing else.

    numba itself raises where no folder can be written, where the disk is full, and where a file is damaged.
    """

    def __init__(self, cache: Any) -> None:
        self._cache = cache

    @classmethod
    def of(cls, function: Callable[..., Any]) -> Any:
        """The cache of a function; one that holds nothing where there is no folder for it."""
        from numba.core.caching import FunctionCache, NullCache

        try:
            return cls(FunctionCache(function))
        except Exception:
            return NullCache()

    def load_overload(self, signature: Any, context: Any) -> Any:
        """The machine code for a signature, or None."""
        try:
            return self._cache.load_overload(signature, context)
        except Exception:  # what damaged files raise is anything; they are written anew
            with suppress(Exception):
                self._cache.flush()
            return None

    def save_overload(self, signature: Any, made: Any) -> None:
        """Keep it where that can be done."""
        with suppress(Exception):
            self._cache.save_overload(signature, made)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)


class Kernel:
    """A function that is compiled when it, or a kernel that calls it, is first called."""

    def __init__(self, function: Callable[..., Any], inline: bool, fastmath: bool | set[str]) -> None:
        self._plain = inspect.unwrap(function)  # the tests' shape checker wraps every function of this package
        # numba looks at a function's own file only: without this, a kernel would keep the helpers of an older version.
        self._plain.__qualname__ = f"{self._plain.__qualname__}_{_VERSION}"
        self._inline, self._fastmath = inline, fastmath
        update_wrapper(self, self._plain)

    def __call__(self, *given: Any) -> Any:
        return self.compiled(*given)

    @cached_property
    def compiled(self) -> Any:
        """What numba makes of the function."""
        with _LOCK:
            if "compiled" in self.__dict__:  # by another thread, meanwhile
                return self.__dict__["compiled"]
            import numba

            options = {"fastmath": self._fastmath, "forceinline": self._inline, "error_model": "numpy"}
            compiled = numba.njit(nogil=True, **options)(self._plain)
            compiled._cache = _Disk.of(self._plain)
            self.__dict__["compiled"] = compiled
            return compiled

    @property
    def _numba_type_(self) -> Any:
        """How numba sees this name inside other kernels."""
        return self.compiled._numba_type_


def kernel(function: Callable[..., Any], *, inline: bool = False, fastmath: bool | set[str] = False) -> Any:
    """Compile a function when it is first called; the machine code stays on disk beside its source.

    Where that folder cannot be written, numba keeps the code in the user's cache folder, and nowhere where that cannot
    be written either.

    Args:
        function: takes arrays and numbers only, without annotations.
        inline: for small helpers that kernels call: their body is copied into the caller by LLVM.
        fastmath: LLVM flags that permit reordering; never where exactness is promised.
    """
    return Kernel(function, inline, fastmath)


def helper(function: Callable[..., Any]) -> Any:
    """A `kernel` that is copied into the kernels that call it."""
    return kernel(function, inline=True)


def workers(stated: int | None = None) -> int:
    """Threads to use: as stated, else one for each processor that this process may run on."""
    return max(1, stated or len(os.sched_getaffinity(0)))


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="scenes")


def _forked() -> None:
    """Threads stay with the parent: a child takes new ones, and waits for no lock that one of them held."""
    _pool.cache_clear()
    _LOCK._at_fork_reinit()  # type: ignore[attr-defined]


os.register_at_fork(after_in_child=_forked)


def spans(work: Callable[[int, int], Any], count: int, size: int, threads: int | None = None) -> None:
    """Call ``work(begin, end)`` for all of `count` places, `size` at a time, on several threads; see `parts`."""
    parts(lambda i: work(size * i, min(size * (i + 1), count)), -(-count // size), threads)


def parts(work: Callable[[int], Any], count: int | Iterable[int], threads: int | None = None) -> list[Any]:
    """Call ``work(i)`` for every part, on several threads, and return the results in order.

    Which thread takes which part changes from run to run; results never may, so parts write to places of their own.
    """
    indices = range(count) if isinstance(count, int) else list(count)
    threads = min(workers(threads), len(indices))
    if threads <= 1:
        return [work(i) for i in indices]
    return list(_pool(threads).map(work, indices))
