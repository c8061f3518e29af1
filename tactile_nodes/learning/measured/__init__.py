"""Fits of the readout `response`."""
