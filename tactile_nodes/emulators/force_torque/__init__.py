"""Force/torque sensors, as a host on their network or serial line sees them."""
