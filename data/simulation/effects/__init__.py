"""What real sensors meet and an ideal simulation leaves out."""

from collections.abc import Collection
from typing import Literal, get_args

from data.common.errors import UserError

Timing = Literal["snapshots", "rolling", "untimed"]
TIMINGS: tuple[Timing, ...] = get_args(Timing)
ALL = "all"
EFFECTS = {
    "snapshots": "all points of a scan are measured at one instant",
    "rolling": "the sensor moves during a scan, and each point has its time (format pcd or ply)",
    "untimed": "as rolling, but points have no times",
    "glass": "windows and curtain walls let seven of ten rays pass",
    "people": "some people walk about in the rooms, one follows the sensor",
    "doors": "doors have leaves: shut, ajar, or wide open where the route leads through",
    "shelves": "shelves, cupboards and tables along the walls, clear of the route",
    "tolerance": "each wall is off its planned position, by 1.5 cm (standard deviation)",
    "returns": "3 cm of noise, a bias per beam, mixed pixels, loss at grazing angles, 30 m of range",
    "steps": "raised floors of 0.3 m in some rooms",
}


def checked(effects: Collection[str]) -> frozenset[str]:
    """The effects; `all` stands for all of them, rolling unless stated otherwise.

    Raises UserError for an unknown name, and for two ways to time the points.
    """
    for name in effects:
        if name not in (*EFFECTS, ALL):
            raise UserError(f"effect '{name}' is not known; give some of {', '.join(EFFECTS)}, or {ALL}")
    if len(timings := [name for name in TIMINGS if name in effects]) > 1:
        raise UserError(f"effects {' and '.join(timings)} exclude each other; give one")
    if ALL in effects:
        return frozenset(EFFECTS) - frozenset(TIMINGS) | frozenset(timings or ["rolling"])
    return frozenset(effects)


def timing_of(effects: frozenset[str], rolling: bool) -> Timing:
    """How points are timed: as the effects say, else by the carrier."""
    return next((name for name in TIMINGS if name in effects), "rolling" if rolling else "snapshots")
