"""Evaluation of models on presses that they never saw."""
