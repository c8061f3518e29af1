"""Force/torque sensors: one protocol, one file per kind."""
