"""What every package needs: the user's error, atomic files, processes, compiled loops, work on a cluster."""
