"""A calibration as presses come: from a rig, or by hand."""
