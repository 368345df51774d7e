"""Measures of trajectories, maps and matches: pure functions."""
