"""The effects by name."""

from collections.abc import Collection
from typing import Literal, get_args

from data.common.errors import UserError

Timing = Literal["snapshots", "rolling", "untimed"]
TIMINGS: tuple[Timing, ...] = get_args(Timing)
EFFECTS = {
    "snapshots": "all points of a scan are measured at one instant",
    "rolling": "each point is measured where the sensor is then, and its time is told (format pcd or ply)",
    "untimed": "as rolling, but the times are not told",
}


def checked(effects: Collection[str]) -> frozenset[str]:
    """The effects. Raises UserError for an unknown name, and for two ways to time the points."""
    for name in effects:
        if name not in EFFECTS:
            raise UserError(f"effect '{name}' is not known; take some of {', '.join(EFFECTS)}")
    if len(timings := [name for name in TIMINGS if name in effects]) > 1:
        raise UserError(f"effects {' and '.join(timings)} exclude each other; take one")
    return frozenset(effects)


def timing_of(effects: frozenset[str], rolling: bool) -> Timing:
    """How points are timed: as the effects say, else by the carrier."""
    return next((name for name in TIMINGS if name in effects), "rolling" if rolling else "snapshots")
