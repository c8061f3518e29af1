"""A person who presses by hand is guided: where, how hard, what is still missing, and when it is enough."""
