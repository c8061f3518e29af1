"""Devices and whole runs that benchmarks and tests alone need, beside those of `tactile_nodes.emulators`."""
