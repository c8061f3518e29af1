"""Fits of the readout `axisymmetric`."""
