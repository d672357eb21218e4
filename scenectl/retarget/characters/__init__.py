"""Skinned characters that play motions: read, posed by rotations, their feet planted."""
