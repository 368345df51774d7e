"""The learned judge: how probable each of several rival placements of a map is, and none of them."""

from matching.judge.judge import Judge
from matching.judge.placements import Placements, placements_of

__all__ = ["Judge", "Placements", "placements_of"]
