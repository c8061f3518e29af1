"""Clocks of several recorders, brought together by the edges of one digital line."""
