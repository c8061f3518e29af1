"""The readout `response`: round tips, with the response measured at every place."""
