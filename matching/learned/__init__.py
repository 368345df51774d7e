"""The trained network without PyTorch: compiled loops over the same weights."""
