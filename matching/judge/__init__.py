"""The learned judge: how probable each of several rival placements of a map is, and none of them."""

from matching.judge.judge import SHIPPED, Judge
from matching.judge.placements import Placements, placements_of

__all__ = ["SHIPPED", "Judge", "Placements", "placements_of"]
