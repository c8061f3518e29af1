"""Benchmarks: all contenders are measured in one run, in turn, on the machine that the report names."""

PROFILES = 'paper', 'fast', 'portable', 'field'
"""The models of the paper's sensor that ship."""
