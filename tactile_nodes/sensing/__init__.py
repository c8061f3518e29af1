"""Computation on arrays: image to displacement, displacement to features, features to force."""
