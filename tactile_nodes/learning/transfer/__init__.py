"""Calibrations for another gel: fits, checks, and files."""
