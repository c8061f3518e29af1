"""Generates text from the code: parts of the documentation, and type stubs of the message classes."""
