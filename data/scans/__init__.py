"""Readers and writers of scans: single files, folders, bags, E57."""

from data.scans.scan import Scan, ScanSource
from data.scans.sources import ScanFolder

__all__ = ["Scan", "ScanFolder", "ScanSource"]
