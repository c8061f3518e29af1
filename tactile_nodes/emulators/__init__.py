"""The simulated world behind the devices' own wire protocols, so that real drivers can be run without hardware."""
