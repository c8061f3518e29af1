"""Machines (CNC, 3D printers) that press: one protocol, one file per kind."""
