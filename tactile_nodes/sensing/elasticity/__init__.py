"""What forces on the surface of a layered gel do to what a camera under it sees."""
