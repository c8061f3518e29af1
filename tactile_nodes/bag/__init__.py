"""Recordings: rosbag2 folders with MCAP files, written from the serialized bytes and read back in time order."""
