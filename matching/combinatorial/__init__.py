"""The combinatorial search of iS-Graphs."""
