"""Damaged files of every format, for every reader."""
