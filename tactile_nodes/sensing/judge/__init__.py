"""Whether a force can be believed: freshness, steadiness, drift of the calibration."""
