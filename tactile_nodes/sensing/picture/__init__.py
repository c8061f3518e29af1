"""Picture faults, motion of the camera, and contact on the gel."""
