"""Evaluation of generators: evaluators, the standard metrics on their embeddings, plausibility, kinds of motion."""

from pathlib import Path

SHIPPED = Path(__file__).with_name("weights")
"""Folder of the weights of our evaluator and of the classifier of kinds."""
