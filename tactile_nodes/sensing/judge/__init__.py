"""Whether a force can be trusted: freshness, steadiness, drift of the calibration."""
