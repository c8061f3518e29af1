"""What all benchmarks share: how one is declared, run, kept, gone on with, drawn again, and seen to be out of date."""
