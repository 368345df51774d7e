"""The pose of each scan: prediction, alignment to walls and floor, floor transitions, kidnapping."""
