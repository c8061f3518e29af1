"""Solved contacts by gel and body: shipped with the package, kept in the cache, or solved now."""
