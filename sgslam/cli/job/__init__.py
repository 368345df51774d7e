"""The job of `sgslam run`: its inputs, read and checked; the run over the scans; its results."""
