"""What the measurements share: records and result pages."""

from evaluation.harness.record_file import RecordFile, read_records, write_records

__all__ = ["RecordFile", "read_records", "write_records"]
