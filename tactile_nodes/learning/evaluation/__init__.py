"""How good a model is on presses that it never saw."""
