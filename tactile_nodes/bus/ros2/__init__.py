"""The bus of a ROS 2 graph."""
