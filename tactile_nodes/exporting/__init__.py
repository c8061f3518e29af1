"""Bags as robot-learning data: parquet, zarr and LeRobot data sets. (Models are exported in learning/.)"""
