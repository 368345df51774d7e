"""Rigid placements of a map in a plan: voting, evidence, verification, assignment of walls and rooms."""
