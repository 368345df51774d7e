"""A run in two processes: one tracks the scans, the other one builds the map."""
