"""Motions as other tools open them: formats by the ending of a file, names of joints, characters.

``sc.export`` is this package and can be called: it is `scenectl.export.export.export`.
"""

import sys
from types import ModuleType
from typing import Any


class _Callable(ModuleType):
    def __call__(self, *arguments: Any, **stated: Any) -> Any:
        from scenectl.export.export import export

        return export(*arguments, **stated)


sys.modules[__name__].__class__ = _Callable
