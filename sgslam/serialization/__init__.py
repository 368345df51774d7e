"""A run's state as a tree of plain values, and as a file."""
