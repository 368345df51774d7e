"""The back end: factor log, optimisation, covariances."""
