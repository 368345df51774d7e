"""Scans as they come: a folder that grows, and bags' records through a pipe."""

from data.streams.arrivals import Arrival, ScanStream
from data.streams.growing_folder import GrowingFolder
from data.streams.mcap_pipe import McapPipe

__all__ = ["Arrival", "GrowingFolder", "McapPipe", "ScanStream"]
