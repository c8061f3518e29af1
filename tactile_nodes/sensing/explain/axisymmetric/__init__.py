"""The readout `axisymmetric`: round tips, with one response for all places."""
