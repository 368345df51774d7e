"""The published matcher: GATv2 encoder, Sinkhorn, Hungarian algorithm; its data and training."""
