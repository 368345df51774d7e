"""Frames, planes under a motion, and small linear systems."""
