"""Our side of every device: a small protocol, the hardware, and the simulated twin, side by side."""
