"""Signed distance grids: how they are baked from meshes, and how they are asked."""
