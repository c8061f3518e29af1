"""Motion of the image content relative to the rest image."""
