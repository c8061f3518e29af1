"""Force/torque sensors: one contract, one file a kind."""
