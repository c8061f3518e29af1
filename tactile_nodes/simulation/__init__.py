"""The physical world as computation: gel, mechanics, optics, and the scene that they make in time."""
