"""A simulated LiDAR on a robot that drives through a building."""
