"""A simulated world behind the real wire protocols of the devices, so that real drivers run without hardware."""
