"""Devices and whole runs for benchmarks and tests only, in addition to `tactile_nodes.emulators`."""
