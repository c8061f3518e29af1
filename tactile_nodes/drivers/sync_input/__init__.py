"""Inputs for the digital line that synchronizes the clocks."""
