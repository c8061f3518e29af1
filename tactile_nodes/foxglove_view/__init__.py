"""Shows all topics of this bus live in Foxglove and Lichtblick."""
