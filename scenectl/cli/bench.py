"""`scenectl bench`: the commands lie with the benches."""

from scenectl.bench.commands import app

__all__ = ["app"]
