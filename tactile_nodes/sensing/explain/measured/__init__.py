"""The readout `response`: ball tips, by the response measured at every place."""
