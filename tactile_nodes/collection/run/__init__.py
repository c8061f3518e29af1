"""A whole run of a plan, and its handling of faults."""
