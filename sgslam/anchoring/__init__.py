"""The map's place in the plan: what a match becomes, what the walls say, when an anchor is withdrawn."""
