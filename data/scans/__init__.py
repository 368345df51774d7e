"""Readers and writers of scans: a folder, a bag, an E57 file."""

from data.scans.folder import Scan, ScanFolder, ScanSource, natural_key

__all__ = ["Scan", "ScanFolder", "ScanSource", "natural_key"]
