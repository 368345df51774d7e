"""Shared by all packages: the user error, atomic files, processes, compiled loops, cluster tasks."""
