"""The smallest configuration that meets a requirement."""
