"""The map: keyframes, walls, rooms, floors, and the S-graph made of them."""
