"""Public data sets, laid out as `sgslam.run` takes them."""
