"""Simulation of the physical world: gel, mechanics, optics, and scenes over time."""
