"""Which forces explain a motion: every readout, and what they share."""
