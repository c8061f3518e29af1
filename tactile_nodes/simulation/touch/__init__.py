"""Rigid bodies of any shape that press, drag and twist the gel: contact solved at finite strain."""
