"""Synchronisation of the clocks of several recorders by the edges of one digital line."""
