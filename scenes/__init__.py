"""What exists: geometry, the body in it, and motion as data. Imports neither objectives nor scenectl.

Each name of `__init__.pyi` is imported when it is first used, so that asking for a floor reads no mesh library.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
