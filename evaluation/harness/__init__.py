"""What the measurements share: driven sequences, records, result pages, matchers that stand in for the real one."""

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
