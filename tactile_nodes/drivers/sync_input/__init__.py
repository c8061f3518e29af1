"""Inputs that see the digital line which synchronises the clocks."""
