"""Between machines: one TCP port, with keys."""
