"""Perception: deskewing, columns, and extraction of walls and floor from one scan."""
