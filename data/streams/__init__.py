"""Scans as they come: a folder that grows, and bags' records through a pipe."""

from data.streams.arrivals import Arrival, McapPipe, ScanStream
from data.streams.growing_folder import GrowingFolder

__all__ = ["Arrival", "GrowingFolder", "McapPipe", "ScanStream"]
