"""A whole run of a plan, and what it does when something goes wrong."""
