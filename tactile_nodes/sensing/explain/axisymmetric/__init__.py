"""The readout `axisymmetric`: ball tips, by one response for all places."""
