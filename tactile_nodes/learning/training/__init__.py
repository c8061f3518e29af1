"""Training from presses to a model file: the source of the presses, the fit, and the card."""
