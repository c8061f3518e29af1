"""Solved contacts by gel and body: shipped with the package, read from the cache, or solved on demand."""
