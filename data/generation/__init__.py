"""Randomly generated buildings, and the demo building."""
