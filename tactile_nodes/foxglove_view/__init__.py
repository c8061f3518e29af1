"""Everything on this bus for Foxglove and Lichtblick to look at, live."""
