"""Evaluation of generators: evaluators, the standard metrics on their embeddings, plausibility, kinds of motion."""
