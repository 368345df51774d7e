"""Frames, transforms of poses and planes, and small linear systems."""
