"""The run: its active and prior maps, checkpoints, snapshots and result."""
