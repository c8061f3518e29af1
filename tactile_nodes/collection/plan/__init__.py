"""Which presses are made, in which order, and what was done of them."""
