"""Fits of the paper's network."""
