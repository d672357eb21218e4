"""Sequences of several acts, made of clips by a motion graph."""
