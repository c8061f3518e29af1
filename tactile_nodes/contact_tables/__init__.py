"""Contacts that were solved before, by gel and body: those that ship, those in the cache, those to be solved now."""
