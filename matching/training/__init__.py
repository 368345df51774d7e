"""Training of the graph network: data, loss, loop and report."""
