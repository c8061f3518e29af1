"""Checks pictures of a sensor against its description: pattern, covered parts, light, focus, noise."""
