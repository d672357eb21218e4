"""Types and shapes in signatures, checked by beartype while the tests run, in half the time that this takes plainly."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from beartype import beartype


def checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """What jaxtyping calls to check arguments, or to check a result (to be named at ``--jaxtyping-packages``).

    Code that checks is made when it is first called: of thousands of functions, a file of tests calls a part. Before
    it checks a result, jaxtyping has checked the arguments and still knows their sizes: only the result is left.
    """
    result = function.__annotations__.get("return", Any)
    if result is not Any:
        function.__annotations__ = {"return": result}
    made: Callable[..., Any] | None = None

    def check(*args: Any, **kwargs: Any) -> Any:
        nonlocal made
        made = made or beartype(function)
        return made(*args, **kwargs)

    return check
