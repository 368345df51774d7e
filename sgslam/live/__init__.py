"""Live use: each scan is answered at once, while the map is built in another process."""
