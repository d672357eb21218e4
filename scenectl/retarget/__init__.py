"""Motions on the bodies of others: skinned characters and robots."""
