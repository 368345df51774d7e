"""Things that stand and that no plan shows."""
