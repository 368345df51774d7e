"""Inspection of a plan before any robot drives, as values and as a page."""
