"""Shared by all packages: the user error, bars, atomic files, processes, compiled loops, cluster tasks."""
