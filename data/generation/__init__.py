"""Buildings drawn by a random generator, and the demo's."""
