"""How it is reached: generators, guidance, refinement, tasks, benchmarks, viewer and command line."""

__version__ = "0.1.0"
