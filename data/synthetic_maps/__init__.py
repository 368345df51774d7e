"""S-graphs drawn from A-graphs, with the noise of real maps."""
