"""Recordings: rosbag2 folders with MCAP files, written from the bytes that travelled and read back in time order."""
