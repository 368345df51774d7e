"""Where a plan repeats itself: symmetries that no matcher can tell apart."""
