"""Shared parts of the measurements: sequences, records, pages, stand-in matchers."""

from evaluation.harness.conditions import Conditions
from evaluation.harness.record_file import RecordFile, read_records, write_records
from evaluation.harness.sequences import Sequence, SequenceSpec, prepare, read_specs, select_sequences

__all__ = [
    "Conditions",
    "RecordFile",
    "Sequence",
    "SequenceSpec",
    "prepare",
    "read_records",
    "read_specs",
    "select_sequences",
    "write_records",
]
