"""Error measures of trajectories, maps and matches: pure functions."""
