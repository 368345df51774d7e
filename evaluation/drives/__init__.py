"""What is measured on: driven sequences, simulated or recorded, their conditions, and stand-in matchers."""

from evaluation.drives.conditions import Conditions
from evaluation.drives.sequences import Sequence, SequenceSpec, prepare, read_specs, select_sequences

__all__ = ["Conditions", "Sequence", "SequenceSpec", "prepare", "read_specs", "select_sequences"]
