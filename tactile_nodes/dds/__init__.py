"""A ROS 2 graph without ROS 2: its topics, types and discovery spoken over DDS (the optional extra `dds`)."""
