"""Inference of the trained graph network without PyTorch, by compiled loops."""

from matching.learned.proposer import LearnedProposer

__all__ = [
    "LearnedProposer",
]
