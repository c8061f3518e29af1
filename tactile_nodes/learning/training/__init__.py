"""A training run from presses to the file of a model: where they come from, what is fitted, what is said of it."""
