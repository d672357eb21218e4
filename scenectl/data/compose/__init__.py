"""Sequences of several acts, made of clips by a motion graph."""

from scenectl.data.compose.graph import composed

__all__ = ["composed"]
