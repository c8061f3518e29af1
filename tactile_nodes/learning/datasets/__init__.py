"""Presses as training samples: simulated or recorded, stored, split and described."""
