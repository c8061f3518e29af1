"""Whether tables of presses tell what their pictures show, be it for a data set or for a calibration."""
