"""The smallest configuration that meets a wish."""
