"""Common code of all benchmarks: declaration, running, storing, resuming, drawing again, and checking their age."""
