"""Beside this file lies what the tests of the folders below import: `rehearsing`."""
