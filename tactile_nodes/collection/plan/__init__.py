"""The presses to make, their order, and the journal of what was done."""
