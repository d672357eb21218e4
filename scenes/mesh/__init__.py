"""Triangles and solids: files, primitives, and surfaces that answer exactly."""
