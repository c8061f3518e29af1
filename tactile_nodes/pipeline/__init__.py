"""The processing of one image, from the camera's message to its force message; used by nodes, tests and benchmarks."""
