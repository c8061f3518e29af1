"""Inner loops compiled by numba: the arithmetic of the numpy code beside which they stand, several times as fast.

Importing this package compiles nothing; its parts do, each by itself, and `every` has them all.
"""
