"""What is known of any LiDAR."""

RANGE_NOISE = 0.02  # m, standard deviation of a range
