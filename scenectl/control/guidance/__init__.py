"""Guidance: goals tilt what a generator believes, step by step."""
