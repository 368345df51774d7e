"""Published networks on our features, and the registry of all networks."""
