"""Anchoring: the place of the map in the plan, from matches and wall alignment, and the anchors that follow."""
