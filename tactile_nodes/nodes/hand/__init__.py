"""Nodes of all sensors of a hand together, and of a gripper that holds something with two of them."""
