"""Readouts, which find the forces that explain a motion, and their common parts."""
