"""From bodies of walls to rooms, wall surfaces, doors, floors and ceilings, of whatever plan."""
