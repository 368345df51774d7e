"""What all matchers share: proposals, a rough start, and the motion that fits matched walls."""

from matching.search.proposals import Proposals, TopK
from matching.search.start import Start, near_start

__all__ = [
    "Proposals",
    "Start",
    "TopK",
    "near_start",
]
