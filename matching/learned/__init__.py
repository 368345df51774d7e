"""The trained network without PyTorch: compiled loops over the same weights."""

from matching.learned.proposer import LearnedProposer

__all__ = [
    "LearnedProposer",
]
