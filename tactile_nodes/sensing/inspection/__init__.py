"""What pictures show of a sensor, judged beside its description: pattern, covered parts, light, focus, noise."""
