"""Studies of drives with any carrier, sensor and effect: tracked alone, with a plan, and in trouble."""
