"""A bridge to a ROS 2 graph without ROS 2: its topics, types and discovery over DDS (the optional extra `dds`)."""
