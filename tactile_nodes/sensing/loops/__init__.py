"""Inner loops compiled by numba: the same arithmetic as the corresponding numpy code, several times as fast.

Importing this package compiles nothing. Each of its modules compiles its own loops, and `every` imports them all.
"""
