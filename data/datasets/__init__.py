"""Public data sets, converted to the input of `sgslam.run`."""
