"""Benchmarks: all contenders are measured in one run, in turn, on the machine that the report names."""
