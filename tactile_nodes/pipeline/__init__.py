"""A picture's way: from the camera's message to the message of its force, as nodes, tests and benches feed it."""
