"""Machines that press: one contract, one file a kind."""
