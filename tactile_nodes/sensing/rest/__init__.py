"""The rest image: capture, preparation, and renewal."""
