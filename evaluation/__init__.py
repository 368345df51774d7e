"""Measurements of the whole system: trajectories, maps and matches against the truth, and run times."""
