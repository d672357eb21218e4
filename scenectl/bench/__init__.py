"""Benchmarks: each prints a table and writes `{"summary": ..., "rows": [...]}`, metres and seconds throughout."""
