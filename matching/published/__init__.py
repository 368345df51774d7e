"""Baselines rebuilt from their papers: the GATv2-Sinkhorn matcher with its training."""
