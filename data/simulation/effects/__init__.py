"""What real sensors meet and an ideal simulation leaves out."""

from data.simulation.effects.names import EFFECTS, Timing, checked, timing_of

__all__ = ["EFFECTS", "Timing", "checked", "timing_of"]
