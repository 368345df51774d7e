"""Public data sets, converted to the input of `sgslam.run`."""

from data.datasets.slabim import SlabimSession

__all__ = [
    "SlabimSession",
]
