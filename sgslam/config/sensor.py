"""What is known of any LiDAR and of the poses that its points are seen from."""

RANGE_NOISE = 0.02  # m, standard deviation of a range; the texture of walls is within it
FURTHEST = 12.0  # m, beyond which half a degree of heading moves a point by a decimetre, and columns are far apart
LEAST_COSINE = 0.3  # of the angle of incidence; at grazing rays a range says little of the surface's place
