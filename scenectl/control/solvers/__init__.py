"""Solvers: numerics that know costs and rows, never bodies."""
