"""Nodes for all sensors of a hand together, and for a gripper that holds an object with two of them."""
