"""A plan before any robot drives: what it lacks, where it repeats itself, how many rooms must be seen."""
