"""Motions as other people write them."""
