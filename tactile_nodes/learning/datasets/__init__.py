"""Presses as training samples: simulated or recorded, kept, split, and described."""
