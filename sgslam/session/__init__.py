"""A run's result and its memory: the prior map, checkpoints, snapshots."""
