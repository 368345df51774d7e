"""From one scan to surfaces: columns, deskewing, walls, floor."""
