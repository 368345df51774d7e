"""Tracking: the pose of each scan by prediction and alignment, floor transitions, kidnap detection."""
