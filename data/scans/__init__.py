"""Readers and writers of scans: a folder, a bag, an E57 file."""

from data.scans.folder import ScanFolder, natural_key
from data.scans.scan import Scan, ScanSource

__all__ = ["Scan", "ScanFolder", "ScanSource", "natural_key"]
