"""Device drivers: for each kind of device a small protocol, the hardware drivers, and a simulated device."""
