"""Motion in the camera image under forces on the surface of a layered gel."""
