"""Readers and writers of scans: single files, folders, bags, E57."""

from data.scans.folder import ScanFolder
from data.scans.scan import Scan, ScanSource

__all__ = ["Scan", "ScanFolder", "ScanSource"]
