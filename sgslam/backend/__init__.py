"""The factor graph: which factors hold and why, its optimisation, its covariances."""
