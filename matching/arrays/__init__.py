"""Scene graphs as numpy arrays: walls, doors, neighbours."""
