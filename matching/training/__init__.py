"""Training: data, loss, loop and report."""
